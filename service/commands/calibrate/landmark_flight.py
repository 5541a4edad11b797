"""What `calibrate` keeps of a recorded flight: the segments near a landmark, the poses' trail, the frames' turns."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from distloc.calibration.image_turns import TurnMeter
from distloc.calibration.mount_calibration import LandmarkSight, angle_rad, landmark_sight
from distloc.sights.detections import detections_from_mask
from distloc.sights.sights import ray_of, sight_of, size_px
from distloc.types import CameraPose, FloatArray, RejectReason
from service.common.messages import Frame
from service.config.sections import Config
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording, RecordingError
from service.segmenters.segment import make_segmenter

GATE_RAD = float(np.radians(10.0))  # about where the old mount puts the landmark: as wrong as a mount may be
_PIXEL_SIGMA_PX = 1.0  # as the localizer's
_NEAREST_M, _FARTHEST_M = 20.0, 200_000.0  # a peak on a clear day
_MOST_FRAMES = 50_000  # 3 hours at 5 Hz
_TRAIL_NS = 20_000_000
_TRAIL_AGE_NS = 300_000_000  # a pose so old has had its later sample
_TRAIL_START = 50  # poses that are asked for in arrears, at the start and after a gap
_MOST_INTERVAL_S = 1.0  # frames further apart share too little


class LandmarkFlight:
    """Reads a recording once. Positions are in the autopilot's ENU axes, attitudes with the config's mount.

    `candidates` has each frame's whole segments within `GATE_RAD` of the landmark; `trail` poses `_TRAIL_NS` apart and
    `turns` (start, end, rotation (3, 3) of the camera between two frames) tell how late the frames are stamped.
    """

    def __init__(self, recording: Recording, config: Config, landmark: tuple[float, float, float]) -> None:
        self.folder: Path = recording.tlog_path.parent
        self._count = len(recording.frames())
        if not self._count:
            raise RecordingError(f"{self.folder}: frames.csv with at least one frame is missing")
        self.candidates: list[list[LandmarkSight]] = []
        self.trail: list[CameraPose] = []
        self.turns: list[tuple[float, float, FloatArray]] = []
        self.with_pose = self.in_view = 0
        self._landmark, self._config = landmark, config
        self._camera = config.camera.camera()
        self._errors = config.pose_errors.pose_errors()
        self._posed = PosedFrames(recording, config)
        self._segmenter = make_segmenter(config.segmenter, self._camera, self.folder)
        self._segmenter_rejects: Counter[RejectReason] = Counter()
        self._cut = 0
        self._least_off_rad = np.inf
        self._trail_ns = 0
        self._meter, self._before_s = TurnMeter(self._camera), -np.inf

    @property
    def landmark_enu_m(self) -> FloatArray:
        """Where the landmark is (3,), once there was a pose."""
        frame_enu = self._posed.autopilot.frame_enu
        assert frame_enu is not None
        return frame_enu.enu_from_geodetic(*self._landmark)

    def read(self, on_progress: Callable[[int], None]) -> None:
        """To the log's end. Raises RecordingError where no segment was near the landmark, and says why."""

        def on_stamp(stamp_ns: int) -> None:
            on_progress(stamp_ns)
            self._follow(stamp_ns)

        for frame, pose in self._posed.pairs(on_stamp):
            self.with_pose += 1
            self._take_turn(frame, pose)
            self._take(frame, pose)
        self._check()

    def _take(self, frame: Frame, pose: CameraPose) -> None:
        line = self.landmark_enu_m - pose.position_enu_m
        range_m = float(np.linalg.norm(line))
        self._check_range(range_m)
        self._least_off_rad = min(self._least_off_rad, angle_rad(line, pose.R_cam_from_enu[2]))
        is_in_view = bool(self._camera.project((pose.R_cam_from_enu @ line)[:, None])[1][0])
        self.in_view += is_in_view
        mask = self._segmenter.segment(frame, pose)
        if isinstance(mask, RejectReason):
            self._segmenter_rejects[mask] += 1
            return
        errors, R_base_from_mount = pose.errors or self._errors, self._config.camera.mount.R_body_from_mount
        near, is_cut = [], False
        for detection in detections_from_mask(mask, self._camera):
            ray = ray_of(self._camera, pose, detection, "centre")
            if angle_rad(ray.axes[2], line) > GATE_RAD:
                continue
            if detection.touches_border:  # its middle is not the landmark's
                is_cut = True
                continue
            sight = sight_of(ray, errors, _PIXEL_SIGMA_PX, range_m, size_px(detection))
            near.append(landmark_sight(sight, pose, errors, R_base_from_mount))
        self._cut += is_cut and not near
        if near and len(self.candidates) == _MOST_FRAMES:
            raise RecordingError(f"{self.folder}: more than {_MOST_FRAMES} frames see the landmark: cut the recording")
        if near:
            self.candidates.append(near)

    def _take_turn(self, frame: Frame, pose: CameraPose) -> None:
        image, stamp_s = frame.image, pose.stamp_s
        if stamp_s - self._before_s > _MOST_INTERVAL_S:
            self._meter.forget()
        if image is None or image.shape != (self._camera.height, self._camera.width, 3):
            self._meter.forget()
            return
        R = self._meter.turn(image, pose, self._ground_up_m)
        if R is not None:
            self.turns.append((self._before_s, stamp_s, R))
        self._before_s = stamp_s

    @property
    def _ground_up_m(self) -> float | None:
        """Home's height in ENU."""
        home_m, frame_enu = self._posed.autopilot.place.home_alt_msl_m, self._posed.autopilot.frame_enu
        return None if home_m is None or frame_enu is None else home_m - frame_enu.origin[2]

    def _follow(self, now_ns: int) -> None:
        until_ns = now_ns - _TRAIL_AGE_NS
        self._trail_ns = max(self._trail_ns, until_ns - _TRAIL_START * _TRAIL_NS)
        while self._trail_ns < until_ns:
            pose = self._posed.autopilot.camera_pose(self._trail_ns, now_ns)
            if isinstance(pose, CameraPose):
                self.trail.append(pose)
            self._trail_ns += _TRAIL_NS

    def _check_range(self, range_m: float) -> None:
        if not _NEAREST_M < range_m < _FARTHEST_M:
            raise RecordingError(
                f"{self.folder}: the landmark is {range_m:.0f} m from the camera, it must be {_NEAREST_M:.0f} m to "
                f"{_FARTHEST_M / 1000:.0f} km off: is it LAT LON ALT, in degrees and metres above the sea?"
            )

    def _check(self) -> None:
        if self.candidates:
            return
        if not self.with_pose:
            raise RecordingError(
                f"{self.folder}: none of {self._count} frames has a pose ({_listed(self._posed.gate.rejects)})"
            )
        if not self.in_view:
            raise RecordingError(
                f"{self.folder}: the landmark was never in view, at least {np.degrees(self._least_off_rad):.0f} deg "
                "off the camera's axis: is it LAT LON ALT, and is the mount right to about 10 deg?"
            )
        seen = f"in view in {self.in_view} of {self.with_pose} frames, but no whole segment within 10 deg of it"
        details = ([f"{self._cut} cut by the border"] if self._cut else []) + (
            [_listed(self._segmenter_rejects)] if self._segmenter_rejects else []
        )
        raise RecordingError(
            f"{self.folder}: the landmark was {seen} (segmenter '{self._config.segmenter.kind}'"
            f"{''.join(f', {detail}' for detail in details)}): --segmenter sobel marks masts, recorded "
            "takes masks of your own"
        )


def _listed(counts: Counter[RejectReason]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in sorted(counts.items()))
