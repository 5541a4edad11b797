"""What the scenery says of the mount over a recorded flight, without a landmark; `calibrate` prints it."""

from collections.abc import Callable

import numpy as np

from distloc.calibration.scenery_mount import AttitudeSight, SceneryMount, mount_from_scenery
from distloc.filter.turning import HeadingOrAzimuth, TurnRate
from distloc.scenery.corner_tracker import CornerTracker
from distloc.scenery.own_parts import own_mask
from distloc.types import RejectReason
from service.config.sections import Config
from service.localise.scenery import make_compass
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording, RecordingError
from service.segmenters.segment import make_segmenter

_LONGEST_HOP_S = 2.0
_MOST_SIGHTS = 100_000


class SceneryFlight:
    """Reads a recording once: the keyframes in which the scenery told the attitude's error."""

    def __init__(self, recording: Recording, config: Config) -> None:
        self.sights: list[AttitudeSight] = []
        self.with_pose = 0
        self.focal = (0.0, np.inf)  # the share by which the true one is longer, where it was surest, and its sigma
        self._folder, self._config = recording.tlog_path.parent, config
        self._posed = PosedFrames(recording, config)
        camera = config.camera.camera()
        self._segmenter = make_segmenter(config.segmenter, camera, self._folder)
        self._tracker = CornerTracker(camera, config.scenery.corners, own=own_mask(camera, config.scenery.own_parts))
        self.compass = make_compass(config, camera)

    def read(self, on_progress: Callable[[int], None]) -> None:
        """To the log's end."""
        turn_rate, heading = TurnRate(), HeadingOrAzimuth()
        told, before_s, keyframe_s = self._config.pose_errors.pose_errors(), -np.inf, -np.inf
        for frame, reported in self._posed.pairs(on_progress):
            self.with_pose += 1
            if frame.image is None:
                continue
            if not 0.0 <= reported.stamp_s - before_s <= _LONGEST_HOP_S:
                self._tracker.forget()
            before_s = reported.stamp_s
            pose = heading.take(reported)
            errors = turn_rate.take(pose, pose.errors or told)
            mask = self._segmenter.segment(frame, pose)
            smoke = None if isinstance(mask, RejectReason) else mask
            self.compass.step(pose, errors, self._tracker.track(frame.image, pose, smoke))
            state = self.compass.state
            if state is not None and state.stamp_s > keyframe_s and len(self.sights) < _MOST_SIGHTS:
                keyframe_s = state.stamp_s
                if state.lens_sigma[0] < self.focal[1]:
                    self.focal = (float(state.lens[0]), float(state.lens_sigma[0]))
                self.sights.append(AttitudeSight(pose, errors, state.error_rad, state.covariance_rad2))

    def mount(self) -> SceneryMount:
        """What the mount is; RecordingError where the flight can't tell."""
        try:
            return mount_from_scenery(self.sights, self._config.camera.mount.R_body_from_mount)
        except ValueError as error:
            reasons = ", ".join(f"{count} {reason}" for reason, count in sorted(self.compass.reasons.items()))
            raise RecordingError(
                f"{self._folder}: of {self.with_pose} frames with a pose {error} ({reasons or 'no pictures'}): fly "
                "past ground with trees or houses, or give a --landmark"
            ) from error
