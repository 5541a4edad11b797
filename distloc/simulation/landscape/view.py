"""From where each row of a frame is seen: a rolling shutter reads them one after the other, from the top down."""

from collections.abc import Callable

import numpy as np

from distloc.geometry.camera import Camera
from distloc.simulation.landscape.texture import Floats
from distloc.types import CameraPose, FloatArray

PoseAt = Callable[[float], CameraPose]

_KNOTS = 9  # poses a readout: between two of them a craft turns evenly
_ROUNDS = 3  # a point's row depends on the pose and the pose on the row


class View:
    """The poses of a frame's rows. The pose's stamp is the middle row's; without a readout all rows share it.

    `pose_at` gives the pose at a stamp; it is asked only where `readout_s` is above 0.
    """

    def __init__(self, camera: Camera, pose: CameraPose, pose_at: PoseAt | None = None, readout_s: float = 0.0) -> None:
        self.camera = camera
        self.pose = pose
        self.is_rolling = pose_at is not None and readout_s > 0.0
        poses = [pose]
        if pose_at is not None and readout_s > 0.0:
            poses = [pose_at(pose.stamp_s + readout_s * (share - 0.5)) for share in np.linspace(0.0, 1.0, _KNOTS)]
        self._R = np.stack([one.R_cam_from_enu for one in poses])
        self._position = np.stack([one.position_enu_m for one in poses])

    def position_enu_m(self, rows: FloatArray) -> FloatArray:
        """Where the camera was (..., 3) when rows (...), which need not be whole, were exposed."""
        return self._between(self._position, rows)

    def R_cam_from_enu(self, rows: FloatArray) -> FloatArray:
        """How it was turned (..., 3, 3)."""
        return self._between(self._R, rows)

    def in_camera(self, points_enu_m: FloatArray) -> FloatArray:
        """Points (3, N) in the camera's axes at the moment at which the row that shows them was exposed."""
        rows = np.full(points_enu_m.shape[1], (self.camera.height - 1) / 2.0)
        for _ in range(_ROUNDS if self.is_rolling else 0):
            row = self.camera.project(self._seen(points_enu_m, rows))[0][1]
            rows = np.where(np.isfinite(row), row, rows)
        return self._seen(points_enu_m, rows)

    def project(self, points_enu_m: FloatArray) -> FloatArray:
        """Pixels (2, N) of points (3, N), also outside the image; NaN where the camera has none."""
        return self.camera.project(self.in_camera(points_enu_m))[0]

    def directions(self, rays_cam: Floats, rows: FloatArray) -> Floats:
        """Rays (3, ...) of the camera's axes in those of the earth; `rows` has the shape of the rest or broadcasts."""
        R = self.R_cam_from_enu(rows).astype(np.float32)
        x, y, z = rays_cam
        return np.stack([R[..., 0, k] * x + R[..., 1, k] * y + R[..., 2, k] * z for k in range(3)])

    def _seen(self, points_enu_m: FloatArray, rows: FloatArray) -> FloatArray:
        if not self.is_rolling:
            return np.asarray(self._R[0] @ (points_enu_m - self._position[0][:, None]))
        offset = points_enu_m.T - self.position_enu_m(rows)
        return np.asarray(np.einsum("nij,nj->in", self.R_cam_from_enu(rows), offset))

    def _between(self, knots: FloatArray, rows: FloatArray) -> FloatArray:
        if len(knots) == 1:
            return np.asarray(np.broadcast_to(knots[0], (*np.shape(rows), *knots.shape[1:])))
        share = np.clip((np.asarray(rows) + 0.5) / self.camera.height, 0.0, 1.0) * (_KNOTS - 1)
        index = np.minimum(share.astype(np.intp), _KNOTS - 2)
        part = (share - index).reshape(*np.shape(rows), *([1] * (knots.ndim - 1)))
        return np.asarray(knots[index] * (1.0 - part) + knots[index + 1] * part)
