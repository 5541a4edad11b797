"""The algorithm on one page: a pose and a mask in, the targets' estimates out."""

import numpy as np

from distloc.filter.ground import Ground
from distloc.filter.platforms import Names
from distloc.filter.settings import LocalizerConfig
from distloc.filter.turning import HeadingOrAzimuth, TurnRate
from distloc.geometry.camera import Camera
from distloc.scenery.compass import Compass
from distloc.scenery.corners import Corners
from distloc.sights.detections import checked_mask, detections_from_mask
from distloc.snapshot import LocalizerSnapshot
from distloc.tracks.bootstrap_tracker import BootstrapTracker
from distloc.tracks.estimates.outlook import Outlook
from distloc.tracks.explanation import Explanation
from distloc.tracks.looks.dirt import Dirt
from distloc.tracks.tracker import Tracker
from distloc.types import CameraPose, Detection, FloatArray, MaskArray, TargetEstimate, TargetState

__all__ = ["Localizer", "LocalizerConfig"]


class _Platform:
    """What is held of one that carries a camera."""

    def __init__(self, compass: Compass, dirt: Dirt) -> None:
        self.compass, self.dirt = compass, dirt
        self.heading, self.turn_rate = HeadingOrAzimuth(), TurnRate()
        self.stepped_at: CameraPose | None = None


class Localizer:
    """Finds the segments and steps the tracker when a step is due.

    `step` returns an estimate for each target, a dismissed one once; between steps it returns the last ones, the same
    objects. `compass` is for who wants another window than the usual, of the first platform.
    """

    def __init__(
        self,
        camera: Camera,
        config: LocalizerConfig | None = None,
        *,
        rng: np.random.Generator,
        compass: Compass | None = None,
    ) -> None:
        self._camera = camera
        self._config = config or LocalizerConfig()
        self._tracker: Tracker | BootstrapTracker
        if self._config.filter == "bootstrap":
            self._tracker = BootstrapTracker(camera, self._config, rng)
        else:
            self._tracker = Tracker(camera, self._config, rng)
        step_m, step_s = self._config.step_distance_m, self._config.step_interval_s
        others = (Compass(camera, step_m, step_s) for _ in range(1, self._config.platforms))
        compasses = (compass or Compass(camera, step_m, step_s), *others)
        sigma_px, self._names = self._config.pixel_sigma_px, Names(self._config.platforms)
        self._platforms = [_Platform(one, Dirt(camera, sigma_px)) for one in compasses]
        self._now = self._platforms[0]  # that looked last
        self._name: str | None = None  # of it; None before the first step
        self._estimates: list[TargetEstimate] = []
        self._explained: Explanation | None = None  # since the last step
        self._camera_enu_m = np.zeros(3)  # at the last step

    def set_ground(self, ground: Ground) -> None:
        """A prior for the heights of targets that start from now on; the bootstrap filter has no use for it."""
        if isinstance(self._tracker, Tracker):
            self._tracker.ground = ground

    @property
    def compass(self) -> Compass:
        """That of the platform that looked last."""
        return self._now.compass

    def doubt_attitude(self, platform: str | None = None) -> None:
        """Tell it that an autopilot began anew, so that its attitude's errors are others.

        That of the platform that looked last where none is named.
        """
        compass = self._of(platform).compass
        compass.doubt_attitude()
        if isinstance(self._tracker, Tracker):
            self._tracker.doubt_attitude(self._name if platform is None else platform, compass.is_used)

    def heading_jumped(self, by_rad: float, platform: str | None = None) -> None:
        """Tell it that a reported heading jumped, clockwise from above, while the camera did not turn.

        That of the platform that looked last where none is named.
        """
        compass = self._of(platform).compass
        compass.heading_jumped(by_rad)
        if isinstance(self._tracker, Tracker):
            self._tracker.heading_jumped(by_rad, self._name if platform is None else platform, compass.is_used)

    def step(self, pose: CameraPose, mask: MaskArray, corners: Corners | None = None) -> list[TargetEstimate]:
        """Take one frame's mask (H, W), bool or uint8, at the camera's size or an exact fraction of it.

        `corners` are those of the scenery that were followed to this frame; with them the attitude's error is measured.
        """
        checked_mask(mask, self._camera)
        if not self._is_due(pose):
            return list(self._estimates)
        return self._stepped(pose, mask, detections_from_mask(mask, self._camera), corners)

    def step_detections(
        self, pose: CameraPose, detections: list[Detection], corners: Corners | None = None
    ) -> list[TargetEstimate]:
        """The same for who has detections instead of a mask."""
        return self._stepped(pose, None, detections, corners) if self._is_due(pose) else list(self._estimates)

    def explain(self) -> Explanation:
        """What there is as of the last step, reported or not, and why each is not confirmed.

        Between steps it is the same object. From the thread that calls `step`, as all else here.
        """
        if self._explained is None:
            self._explained = self._tracker.explain(self._camera_enu_m)
        return self._explained

    def outlook(self, target_id: int) -> Outlook | None:
        """What is known of a target after the last step, as `distloc.advice` takes it.

        None for a number that no target has, and for the bootstrap filter. It holds copies: any thread may work on it.
        """
        return self._tracker.outlook(target_id) if isinstance(self._tracker, Tracker) else None

    def snapshot(self) -> LocalizerSnapshot:
        """All that another localizer of the same camera and config needs to go on with the targets and their ids.

        ValueError for the bootstrap filter: its cloud takes the poses as exact, which they are not across a restart.
        """
        return self._calibrated().snapshot()

    def restore(self, saved: LocalizerSnapshot) -> None:
        """Go on from a snapshot, before the first step; what was confirmed coasts until it is seen again.

        ValueError where there was a step, more targets than places, or for the bootstrap filter.
        """
        self._calibrated().restore(saved)
        self._explained = None
        if self._config.platforms > 1:
            self._now, self._name = self._of(saved.platform), saved.platform

    def _calibrated(self) -> Tracker:
        if not isinstance(self._tracker, Tracker):
            raise ValueError("filter must be 'calibrated' for snapshots, got 'bootstrap'")
        return self._tracker

    def particles_enu_m(self, target_id: int) -> FloatArray | None:
        """Equally likely particles (3, n) of a live target, for a picture; don't write into them."""
        return self._tracker.particles_enu_m(target_id)

    def _of(self, platform: str | None) -> _Platform:
        """What is held of a platform, None for that which looked last. ValueError for one name too many."""
        return self._now if platform is None else self._platforms[self._names.number(platform)]

    def _is_due(self, pose: CameraPose) -> bool:
        numbers = (pose.position_enu_m, pose.R_cam_from_enu, pose.stamp_s)
        if not all(np.isfinite(one).all() for one in numbers) or not np.isfinite(pose.heading_rad or 0.0):
            raise ValueError("the pose must be finite")
        last = self._of(pose.platform).stepped_at
        if last is None:
            return True
        if float(np.linalg.norm(pose.position_enu_m - last.position_enu_m)) >= self._config.step_distance_m:
            return True
        waited_s = pose.stamp_s - last.stamp_s
        # a clock that went back says nothing of how long it was
        return self._config.filter == "calibrated" and not 0.0 <= waited_s < self._config.step_interval_s

    def _stepped(
        self, pose: CameraPose, mask: MaskArray | None, detections: list[Detection], corners: Corners | None
    ) -> list[TargetEstimate]:
        self._now, self._name = self._of(pose.platform), pose.platform
        reported = self._now.heading.take(pose)
        errors = self._now.turn_rate.take(reported, reported.errors or self._config.pose_errors)
        pose = self.compass.step(reported, errors, corners)
        if isinstance(self._tracker, Tracker):
            self._tracker.camera, self._tracker.dirt = self.compass.camera, self._now.dirt
        self._explained, self._camera_enu_m = None, pose.position_enu_m
        estimates = self._tracker.step(pose, mask, detections)
        self._estimates = [one for one in estimates if one.state is not TargetState.DISMISSED]
        # with nothing to follow the next frame is due at once
        self._now.stepped_at = reported if self._estimates or detections else None
        return estimates
