"""The scenery as a compass while flying: each frame's corners, and what they tell of the reported attitude.

The localise stage asks for the corners of the frames that it gets and notes what the compass made of them. In flight
the follower owns the corners, on its own thread. Any thread may read `state`, which is replaced as a whole.
"""

import logging
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from distloc.backports import StrEnum
from distloc.geometry.camera import Camera
from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.scenery.compass import Compass
from distloc.scenery.corner_tracker import CornerTracker
from distloc.scenery.corners import Corners, KnownCorners
from distloc.scenery.own_parts import own_mask
from distloc.types import CameraPose, FloatArray, PoseErrors, RejectReason
from service.camera.source import fits
from service.common.messages import Frame
from service.config.doubts import told_errors
from service.config.sections import Config, MountConfig, Polygon, PoseErrorsConfig
from service.localise.held import OLD_S, Held
from service.localise.landmark_watch import MISFIT, Landmarks, NoLandmarks, WatchedLandmarks
from service.localise.mount_watch import MountState, MountWatch

Mask = NDArray[np.uint8]

log = logging.getLogger(__name__)

OFF_RAD = math.radians(1.5)  # a heading's error worth a pilot's notice
BAD_RAD = math.radians(10.0)  # no compass that is calibrated errs so
HELD_S = 10.0  # and so long
_LONGEST_HOP_S = 2.0
_PLACES_A_CORNER = 5  # that come and go while a window passes
_LEAST_PLACES = 256


class Lacking(StrEnum):
    """Why a frame gave no corners, or none that were followed to it; the compass has its own reasons."""

    NO_IMAGE = "no_image"
    FRAME_SIZE = "frame_size"
    REPEATED_STAMP = "repeated_stamp"
    TRACKER_FAILED = "tracker_failed"
    STAMP_BACK = "stamp_back"
    FRAME_GAP = "frame_gap"
    SIZE_CHANGED = "size_changed"


@dataclass(frozen=True, slots=True)
class SceneryState:
    """What is known of the reported attitude's error; the angles are None while nothing is measured.

    `error_rad` (3,) is a rotation vector about east, north and up that turns true directions into reported ones,
    `sigma_rad` (3,) one standard deviation. `source` says whose attitude is used. `off_s` is for how long the heading
    has been off by OFF_RAD, `bad_s` by BAD_RAD, each to the same side and by SURE sigmas. `mount` is what the flight
    so far says of the camera's mount, `landmarks` what each is good for now.
    """

    source: Literal["scenery", "autopilot", "off"]
    stamp_s: float = -math.inf
    error_rad: FloatArray | None = None
    sigma_rad: FloatArray | None = None
    corners: int = 0
    reasons: Mapping[str, int] = field(default_factory=dict)
    off_s: float = 0.0
    bad_s: float = 0.0
    mount: MountState | None = None
    landmarks: Mapping[str, str] = field(default_factory=dict)

    @property
    def heading_error_rad(self) -> float | None:
        """The reported heading minus the true one, clockwise from above: a compass that reads too much has a plus."""
        return None if self.error_rad is None else -float(self.error_rad[2])

    @property
    def is_off(self) -> bool:
        """Whether the heading's error is worth telling the pilot of."""
        return self.off_s >= HELD_S

    @property
    def is_bad(self) -> bool:
        """Whether somebody should mend it."""
        return self.bad_s >= HELD_S

    def corrected(self, pose: CameraPose) -> CameraPose:
        """A reported pose with the attitude that is used."""
        if self.source != "scenery" or self.error_rad is None:
            return pose
        return replace(pose, R_cam_from_enu=pose.R_cam_from_enu @ matrix_from_rotation_vector(self.error_rad))

    def at(self, now_s: float) -> "SceneryState":
        """The same as it holds now: nothing is measured where the last keyframe is long ago."""
        if self.source == "off" or 0.0 <= now_s - self.stamp_s <= OLD_S:
            return self
        return replace(
            self,
            source="autopilot",
            error_rad=None,
            sigma_rad=None,
            corners=0,
            off_s=0.0,
            bad_s=0.0,
            landmarks=dict.fromkeys(self.landmarks, "unseen"),
        )


class Scenery(Protocol):
    """What the stage calls, in its order, for each frame."""

    @property
    def state(self) -> SceneryState:
        """After the last frame."""
        ...

    def track(self, frame: Frame, pose: CameraPose, mask: Mask | RejectReason) -> Corners | None:
        """The frame's corners outside of its smoke; None where it has none to give."""
        ...

    def note(self, compass: Compass) -> None:
        """The localizer has stepped."""
        ...


class NoScenery:
    """For `scenery.enabled = false`."""

    state = SceneryState("off")

    def track(self, frame: Frame, pose: CameraPose, mask: Mask | RejectReason) -> None:
        """No corners, ever."""

    def note(self, compass: Compass) -> None:
        """Nothing to note."""


class FollowedScenery:
    """Follows corners through the frames; a frame that they can't be followed in costs its corners alone.

    `lacking` counts such frames. The tracker begins anew after one that failed, after a gap of over 2 s, where stamps
    go back and where the frames' size changes.
    """

    def __init__(
        self,
        camera: Camera,
        corners: int,
        own_parts: tuple[Polygon, ...] = (),
        mount: MountWatch | None = None,
        landmarks: Landmarks | None = None,
        told: PoseErrors | None = None,
    ) -> None:
        self.state = SceneryState("autopilot")
        self.lacking: Counter[Lacking] = Counter()
        self._camera = camera
        self._told = told or PoseErrorsConfig().pose_errors()
        self._mount = mount or MountWatch(MountConfig(), self._told)
        self._landmarks = landmarks or NoLandmarks()
        self._tracker = CornerTracker(camera, corners, own=own_mask(camera, own_parts))
        self._smoke: Mask | None = None
        self._stamp_s: float | None = None
        self._shape: tuple[int, ...] = ()
        self._off, self._bad = Held(OFF_RAD), Held(BAD_RAD)
        self._is_failing = False

    def track(self, frame: Frame, pose: CameraPose, mask: Mask | RejectReason) -> Corners | None:
        """The corners of a frame outside of the smoke: this frame's, or the last one's where it has no mask."""
        smoke = None if isinstance(mask, RejectReason) else mask
        return self._guarded(frame, lambda: self._and_new(self._followed(frame, pose, smoke)))

    def follow(self, frame: Frame, pose: CameraPose) -> Corners | None:
        """Corners from before in a frame whose mask is not made, or never will be; `outside` has those that count."""
        return self._guarded(frame, lambda: self._followed(frame, pose, None))

    def look(self, frame: Frame) -> None:
        """After `follow`, once there is time: new corners for the frames to come."""
        self._guarded(frame, lambda: self._tracker.look(self._smoke))

    def outside(self, frame: Frame, corners: Corners | None, mask: Mask | RejectReason) -> Corners | None:
        """Those of a followed frame's corners and landmarks that are not in its smoke; it holds for frames to come."""
        if isinstance(mask, RejectReason):
            return corners
        self._smoke = mask
        return corners and self._guarded(
            frame, lambda: self._tracker.outside(self._landmarks.outside(corners, mask), mask)
        )

    def note(self, compass: Compass) -> None:
        """Make the state of what the localizer's compass says."""
        lacking = dict(self.lacking)  # copied at once: another thread may count on
        reasons = {str(one): count for one, count in (*compass.reasons.items(), *lacking.items())}
        landmarks = self._landmarks.note(compass.aided)
        if misfits := int(compass.aided.misfits.sum()):
            reasons[MISFIT] = misfits
        source: Literal["scenery", "autopilot"] = "scenery" if compass.is_used else "autopilot"
        said = compass.state
        if said is None or not (np.isfinite(said.error_rad).all() and np.isfinite(said.sigma_rad).all()):
            self._off.reset()
            self._bad.reset()
            self.state = SceneryState("autopilot", reasons=reasons, mount=self._mount.state, landmarks=landmarks)
            return
        self._mount.note(said)
        heading_rad, sigma_rad = -float(said.error_rad[2]), said.fit_sigma_rad
        self.state = SceneryState(
            source,
            stamp_s=said.stamp_s,
            error_rad=said.error_rad.copy(),
            sigma_rad=said.sigma_rad.copy(),
            corners=said.corners,
            reasons=reasons,
            off_s=self._off.for_s(heading_rad, sigma_rad, said.stamp_s),
            bad_s=self._bad.for_s(heading_rad, sigma_rad, said.stamp_s),
            mount=self._mount.state,
            landmarks=landmarks,
        )

    def _known(self, image: NDArray[np.uint8], pose: CameraPose) -> KnownCorners:
        """The landmarks in a frame, looked for where the attitude as measured puts them, or else the reported one."""
        state, told = self.state.at(pose.stamp_s), pose.errors or self._told
        sigma_rad = max(told.heading_bias_rad, told.tilt_bias_rad)
        if state.error_rad is not None and state.sigma_rad is not None:
            pose = replace(pose, R_cam_from_enu=pose.R_cam_from_enu @ matrix_from_rotation_vector(state.error_rad))
            sigma_rad = float(np.hypot(state.sigma_rad.max(), told.attitude_white_rad))
        return self._landmarks.find(image, pose, sigma_rad, self._smoke)

    def _guarded(self, frame: Frame, look: Callable[[], Corners | None]) -> Corners | None:
        try:
            corners = look()
        except Exception as error:  # whatever it is, it costs this frame's corners
            if not self._is_failing:
                log.warning("corners of the scenery are not followed in frame %s: %s", frame.name, error)
            self._is_failing = True
            self._begin_anew()
            self.lacking[Lacking.TRACKER_FAILED] += 1
            return None
        self._is_failing = self._is_failing and corners is None
        return corners

    def _followed(self, frame: Frame, pose: CameraPose, smoke: Mask | None) -> Corners | None:
        if frame.image is None or not fits(self._camera, frame.image):
            self.lacking[Lacking.NO_IMAGE if frame.image is None else Lacking.FRAME_SIZE] += 1
            return None
        if pose.stamp_s == self._stamp_s:
            self.lacking[Lacking.REPEATED_STAMP] += 1
            return None
        if (broken := self._broken(pose.stamp_s, frame.image.shape[:2])) is not None:
            self.lacking[broken] += 1
            self._begin_anew()
        self._smoke = self._smoke if smoke is None else smoke
        self._stamp_s, self._shape = pose.stamp_s, frame.image.shape[:2]
        return replace(self._tracker.follow(frame.image, pose, self._smoke), known=self._known(frame.image, pose))

    def _and_new(self, followed: Corners | None) -> Corners | None:
        return followed and replace(self._tracker.look(self._smoke), known=followed.known)

    def _broken(self, stamp_s: float, shape: tuple[int, ...]) -> Lacking | None:
        """Why nothing can be followed from the frame before."""
        if self._stamp_s is None:
            return None
        if stamp_s < self._stamp_s:
            return Lacking.STAMP_BACK
        if stamp_s - self._stamp_s > _LONGEST_HOP_S:
            return Lacking.FRAME_GAP
        return None if shape == self._shape else Lacking.SIZE_CHANGED

    def _begin_anew(self) -> None:
        self._tracker.forget()
        self._landmarks.forget()
        self._smoke = None


def make_scenery(config: Config, camera: Camera, frame_enu: Callable[[], LocalFrame | None]) -> Scenery:
    """What the config asks for; `frame_enu` gives the map's axes once they are known."""
    section = config.scenery
    if not section.enabled:
        return NoScenery()
    told = told_errors(config)
    landmarks = WatchedLandmarks(camera, config.landmarks, frame_enu) if config.landmarks else NoLandmarks()
    mount = MountWatch(config.camera.mount, told)
    return FollowedScenery(camera, section.corners, section.own_parts, mount, landmarks, told)


def make_compass(config: Config, camera: Camera) -> Compass:
    """The localizer's compass with the config's window."""
    section, steps = config.scenery, config.localizer
    places = max(_LEAST_PLACES, _PLACES_A_CORNER * section.corners)
    sigma_m = np.array([one.sigma_enu_m for one in config.landmarks]).reshape(-1, 3)
    return Compass(camera, steps.step_distance_m, steps.step_interval_s, section.window, places, sigma_m)
