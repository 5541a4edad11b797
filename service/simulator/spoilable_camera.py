"""What a camera gives of a simulated scene, with faults on order; the soak's renderer and the fault tests use it."""

from dataclasses import replace

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.simulation.plume import PlumePainter
from distloc.simulation.renderer import HAZE_BGR, HAZE_RANGE_M
from distloc.types import CameraPose
from service.config.sections import CameraConfig
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import Scenario, camera_pose, plumes

Image = NDArray[np.uint8]
_FALSE_ALARMS = 12  # all round: two or three of them in view
_BLACK = 3  # a covered sensor's noise, in grey levels


class SpoilableCamera:
    """Draws the scene as it is at a moment; each fault lasts while its attribute says so.

    With `shrink` it is drawn at so many times fewer columns and rows, then enlarged: that costs much less.
    """

    def __init__(self, scenario: Scenario, start_ns: int, seed: int = 5, shrink: int = 1) -> None:
        self.is_frozen = False
        self.is_corrupt = False
        self.is_black = False
        self.is_white = False
        self.has_false_alarms = False
        self.size: tuple[int, int] | None = None  # another width and height than the camera's
        self.given = 0
        self._scenario, self._start_ns = scenario, start_ns
        self._shape = (scenario.camera.height, scenario.camera.width, 3)
        self._camera = _shrunk(scenario.camera, shrink).camera()
        self._scene = DrawnScene(scenario, np.random.default_rng(seed), self._camera)
        self._rng = np.random.default_rng(seed + 1)
        self._false_smoke = PlumePainter(plumes(scenario)[0], self._rng)
        self._last: Image | None = None

    def picture(self, exposed_ns: int) -> Image | None:
        """The frame (H, W, 3) exposed then; None where it is a JPEG that cannot be decoded."""
        if not self.is_frozen or self._last is None:
            self._last = self._taken(exposed_ns)
        self.given += 1
        if not self.is_corrupt:
            return self._last
        jpeg = self._spoilt(cv2.imencode(".jpg", self._last)[1].tobytes())
        decoded = cv2.imdecode(np.frombuffer(jpeg, dtype=np.uint8), cv2.IMREAD_COLOR)
        return None if decoded is None else np.asarray(decoded, dtype=np.uint8)

    def _taken(self, exposed_ns: int) -> Image:
        if self.is_black:
            return self._rng.integers(0, _BLACK, self._shape, dtype=np.uint8)
        if self.is_white:
            return np.full(self._shape, 255, np.uint8)
        t_s = (exposed_ns - self._start_ns) * 1e-9
        pose = camera_pose(self._scenario, t_s, t_s)
        image = self._scene.seen_at(t_s)
        if self.has_false_alarms:
            self._paint_false_alarms(image, pose)
        size = self.size or self._shape[1::-1]
        return image if image.shape[1::-1] == size else np.asarray(cv2.resize(image, size), dtype=np.uint8)

    def _paint_false_alarms(self, image: Image, pose: CameraPose) -> None:
        """Smoke as it is seen elsewhere, in other places of each frame."""
        for _ in range(_FALSE_ALARMS):
            turn = matrix_from_rotation_vector(np.array([0.0, 0.0, self._rng.uniform(-np.pi, np.pi)]))
            other = replace(pose, R_cam_from_enu=pose.R_cam_from_enu @ turn)
            alpha = np.zeros(image.shape[:2], np.float32)
            self._false_smoke.paint(self._camera, other, HAZE_BGR, HAZE_RANGE_M, image, alpha)

    def _spoilt(self, jpeg: bytes) -> bytes:
        """In turn: without its beginning, cut in the middle, with wrong bytes in the scan."""
        kind = self.given % 3
        if kind == 0:
            return jpeg[100:]
        if kind == 1:
            return jpeg[: len(jpeg) // 2]
        data = np.frombuffer(jpeg, dtype=np.uint8).copy()
        data[self._rng.integers(len(data) // 3, len(data), 40)] = self._rng.integers(0, 255, 40)
        return data.tobytes()


def _shrunk(camera: CameraConfig, by: int) -> CameraConfig:
    """The same view in fewer pixels, whose centres are the whole numbers."""
    full = camera.camera()
    return msgspec.structs.replace(
        camera,
        width=full.width // by,
        height=full.height // by,
        hfov_deg=None,
        fx=full.fx / by,
        fy=full.fy / by,
        cx=(full.cx + 0.5) / by - 0.5,
        cy=(full.cy + 0.5) / by - 0.5,
    )
