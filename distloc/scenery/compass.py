"""What the reported attitude is wrong by, from corners in the frames: a pose in, the corrected pose out.

The localizer has one. Each of its steps is a keyframe of the window. The answer is used while it is surer than what the
autopilot's attitude is told to be; else the reported attitude stands, with the sizes of its errors.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from distloc.backports import StrEnum
from distloc.geometry.camera import Camera
from distloc.scenery.aided import Aided, Answer, answer_of
from distloc.scenery.corners import Corners, KnownCorners, mended, seen_from
from distloc.scenery.handover import BeyondTold, Handover
from distloc.scenery.information import Chain
from distloc.scenery.landmarks import LENS
from distloc.scenery.steadiness import Leaps, Steadiness, let_go
from distloc.scenery.unrest import LEAST_KEYFRAMES, Unrest
from distloc.scenery.window import Window
from distloc.types import CameraPose, FloatArray, PoseErrors

_WIDER = 2.5  # the heading's prior: it costs nothing here, and what is told may be too small
_MOST_POSITION_WHITE_M = 0.1  # of a position's error from frame to frame: the rest is slow
_LEAST_CORNERS = 8
_PROMISING, _AWAITED = 15, 15  # corners, and places of the window; keyframes, less those since then that told
_WORST_FIT = 6.0  # mean squared residual: nothing of the model holds
_JUMP_ROUNDS = 3
_LONGEST_GAP_S = 60.0
_LEARNT_S = 60.0
_LENS_TOLD = (0.02, 0.03)  # of the focal length, a share, and of k1: what a calibration or a data sheet errs by
_OF_STRETCH = np.array([1.0, 0.1])  # what these make of the image's scale where smoke usually is
_MOST_JUMP_RAD = float(np.radians(30.0))  # of a heading, to go on with what the window holds
_NEARLY = 0.9  # of a step


class SceneryReason(StrEnum):
    """Why a keyframe's attitude is the autopilot's."""

    FEW_CORNERS = "few_corners"
    MISFIT = "misfit"
    UNSOLVED = "unsolved"
    MOVING = "moving"
    UNSTEADY = "unsteady"
    NOT_SURER = "not_surer"
    GAP = "gap"


@dataclass(frozen=True, slots=True)
class CompassState:
    """What the scenery says now: the reported attitude's error about east, north and up (3,), its covariance (3, 3).

    The error turns true directions into reported ones. `stamp_s` is the keyframe's; `lens` +- `lens_sigma` (2,) are the
    share by which the true focal length is longer, and by what its first radial coefficient is more. `reported` is the
    keyframe's pose as it came, with the errors that were told.
    """

    error_rad: FloatArray
    covariance_rad2: FloatArray
    corners: int
    jumps: int
    stamp_s: float
    lens: FloatArray
    lens_sigma: FloatArray
    reported: CameraPose | None = None
    landmarks: int = 0  # of known place, that helped
    fit_sigma_rad: float = 0.0  # of the heading, were it sure that the ground stands still

    @property
    def sigma_rad(self) -> FloatArray:
        """One standard deviation about each axis (3,)."""
        return np.sqrt(np.diag(self.covariance_rad2))


class Compass:
    """Fixed memory: a window of `keyframes` and a pool of `places`; landmarks of known place have a second window.

    `landmark_sigma_m` (m, 3) is one standard deviation of each landmark's place.
    """

    def __init__(
        self,
        camera: Camera,
        step_distance_m: float = 10.0,
        step_interval_s: float = 1.0,
        keyframes: int = 25,
        places: int = 256,
        landmark_sigma_m: FloatArray | None = None,
    ) -> None:
        self._step_distance_m, self._step_interval_s = step_distance_m, step_interval_s
        self.reasons: Counter[SceneryReason] = Counter()
        self.state: CompassState | None = None
        self._camera = camera
        self._window = Window(keyframes, places, _LENS_TOLD)
        self.aided = Aided(np.zeros((0, 3)) if landmark_sigma_m is None else landmark_sigma_m)
        self._lens, self._lens_sigma = np.zeros(LENS), np.zeros(LENS)
        self._stamp_s: float | None = None
        self._place_m = np.zeros(3)
        self._handover = Handover()
        self._leaps = Leaps()
        self._slow = np.zeros(6)  # variances that the chain had last
        self._moved_rad = 0.0
        self._is_doubted = False
        self._learnt = 0.0  # of the heading's variance: what the scenery saw
        self._jumps = 0
        self._unrest = Unrest()
        self._steadiness = Steadiness()
        self._beyond_told = BeyondTold()
        self._awaited = 0

    @property
    def is_used(self) -> bool:
        """Whether the last pose was corrected by it."""
        return self._handover.is_scenery

    @property
    def camera(self) -> Camera:
        """The camera with the lens that the scenery told, as sure as it was: its prior holds it back."""
        return mended(self._camera, *self._lens.tolist())

    def heading_jumped(self, by_rad: float) -> None:
        """The reported heading jumped by an angle, clockwise from above, while the camera did not turn."""
        self._moved_rad -= by_rad

    def doubt_attitude(self) -> None:
        """The reported attitude's errors are others from now on."""
        self._is_doubted = True

    def step(self, pose: CameraPose, errors: PoseErrors, corners: Corners | None) -> CameraPose:
        """The pose to go on with; `errors` are the reported one's. Without corners ever it stays as it is."""
        if corners is None and self._stamp_s is None:
            return replace(pose, errors=errors)
        pose, told_rad = self._leaps.taken_off(replace(pose, errors=errors)), errors.heading_bias_rad
        errors = replace(self._told(errors), focal_sigma=float(self._lens_sigma @ _OF_STRETCH))
        handover = self._handover
        if not self._is_due(pose):
            elapsed_s = pose.stamp_s - (self._stamp_s or 0.0)
            return handover.between(pose, self._leaps.told(errors), max(elapsed_s, 0.0))
        chain, elapsed_s = self._chain(pose, errors)
        kept, offset_m = float(chain.kept[0]), self._leaps.offset_m
        found = self._solved(pose, chain, corners)
        pose = replace(pose, position_enu_m=pose.position_enu_m - (self._leaps.offset_m - offset_m))
        self._place_m, errors = pose.position_enu_m, self._leaps.told(errors)
        sure = None if found is None else self._beyond_told.weighed(found, told_rad, self._leaps.moved_m)
        self.state = None
        if found is not None and sure is not None:
            fit_sigma_rad = float(np.sqrt(found.covariance[2, 2]))
            self.state = _state(sure, pose, self._window.used, self._jumps, fit_sigma_rad)
        if found is None or sure is None or not handover.is_surer(found.error_rad, found.covariance, errors):
            self.reasons[SceneryReason.NOT_SURER] += found is not None
            if not self._is_awaited(corners):
                return handover.by_autopilot(pose, errors, kept)
            self._awaited += 1
            # what is learnt from what was told would stay
            wider = replace(errors, heading_bias_rad=_WIDER * errors.heading_bias_rad)
            return handover.by_autopilot(pose, wider, kept, is_about_to_tell=True)
        self._awaited = max(self._awaited - 1, 0)
        self._learn(found.error_rad[2] ** 2, elapsed_s)
        self._lens, self._lens_sigma = found.lens, found.lens_sigma
        return handover.by_scenery(pose, errors, kept, (sure.error_rad, sure.covariance, sure.with_last))

    def _is_due(self, pose: CameraPose) -> bool:
        """Whether a pose makes a keyframe: nearer ones would fill the window with one place."""
        if self._stamp_s is None or self._is_doubted or self._moved_rad:
            return True
        if not 0.0 <= pose.stamp_s - self._stamp_s < _NEARLY * self._step_interval_s:
            return True
        return float(np.linalg.norm(pose.position_enu_m - self._place_m)) >= _NEARLY * self._step_distance_m

    def _told(self, errors: PoseErrors) -> PoseErrors:
        """What the errors are told to be, larger where the scenery saw larger ones."""
        return replace(errors, heading_bias_rad=float(np.sqrt(max(errors.heading_bias_rad**2, self._learnt))))

    def _is_awaited(self, corners: Corners | None) -> bool:
        """Whether the scenery is about to tell: there are corners enough, they stand still, and it may yet be soon."""
        window = self._window
        is_promising = window.used >= _PROMISING or window.count < LEAST_KEYFRAMES
        has_corners = corners is not None and corners.names.size >= _PROMISING
        is_restless = self._unrest.is_restless or self._steadiness.is_restless
        return is_promising and has_corners and self._awaited < _AWAITED and not is_restless

    def _learn(self, squared_rad2: float, elapsed_s: float) -> None:
        kept = float(np.exp(-elapsed_s / _LEARNT_S))
        self._learnt = max(kept * self._learnt + (1.0 - kept) * squared_rad2, 0.0)

    def _chain(self, pose: CameraPose, errors: PoseErrors) -> tuple[Chain, float]:
        """From the keyframe before to this one; it begins anew where there is none, or long ago."""
        elapsed_s = 0.0 if self._stamp_s is None else pose.stamp_s - self._stamp_s
        if not 0.0 <= elapsed_s < _LONGEST_GAP_S:
            self.reasons[SceneryReason.GAP] += 1
            self._window.reset()
            elapsed_s = 0.0
        self._stamp_s = pose.stamp_s
        slow = np.concatenate([np.diag(errors.bias_variance), np.full(3, errors.position_bias_m**2)])
        kept = np.full(6, np.exp(-elapsed_s / errors.bias_time_constant_s))
        is_first = self._window.count == 0
        if self._is_doubted or is_first:
            kept[:3] = 0.0
        new = (1.0 - kept**2) * slow + np.maximum(slow - self._slow, 0.0)
        if is_first:
            new = slow.copy()
        if self._is_doubted or is_first:
            new[2] *= _WIDER**2
        new[3:] += (
            0.0
            if self._is_doubted or is_first
            else self._leaps.note(pose.position_enu_m - self._place_m, elapsed_s) ** 2
        )
        moved = np.array([0.0, 0.0, self._moved_rad, 0.0, 0.0, 0.0])
        white = np.square([errors.attitude_white_rad] * 3 + [min(errors.position_m, _MOST_POSITION_WHITE_M)] * 3)
        self._moved_rad, self._is_doubted, self._slow = 0.0, False, slow
        return Chain(kept, new, white, moved), elapsed_s

    def _solved(self, pose: CameraPose, chain: Chain, corners: Corners | None) -> Answer | None:
        """What the window says, with the landmarks where those help; None where it fails."""
        window, seen = self._window, seen_from(self._camera, pose, corners)
        window.usual = window.usual if corners is None else corners.usual
        try:
            window.add(pose.position_enu_m, pose.R_cam_from_enu[2], chain, seen)
            covariance = self._settled(chain)
        except np.linalg.LinAlgError:
            self._fail(SceneryReason.UNSOLVED)
            return None
        if window.misfit > _WORST_FIT or window.wrong > max(window.used, _LEAST_CORNERS):
            self._fail(SceneryReason.MISFIT)
            return None
        known = KnownCorners() if corners is None else corners.known
        of_known = seen_from(self._camera, pose, known)
        places_m = known.places_enu_m[np.isin(known.names, of_known.names)]
        found = self.aided.step(window, covariance, pose, seen, of_known, places_m) or answer_of(window, covariance)
        is_few = window.used < _LEAST_CORNERS
        is_moving = self._unrest.is_moving(window)
        self.reasons[SceneryReason.FEW_CORNERS] += is_few
        self.reasons[SceneryReason.MOVING] += is_moving
        self.reasons[SceneryReason.UNSTEADY] += self._steadiness.is_restless
        if is_moving or self._steadiness.is_restless or window.count < self._unrest.needed:
            return None
        self._unrest.believed()
        return found

    def _settled(self, chain: Chain) -> FloatArray:
        """Solve; where the slow errors step farther than they can, they jumped: that is let go, and solved again.

        A position that jumped is from then on taken as it was before.
        """
        window, steadiness = self._window, self._steadiness
        covariance = window.solve()
        if window.count < 2 or window.used < _LEAST_CORNERS:
            return covariance
        has_jumped = np.zeros(6, dtype=np.bool_)
        for _ in range(_JUMP_ROUNDS):
            step = window.last_step(chain)
            is_jump = steadiness.jumps(step, chain)
            if not is_jump.any():
                break
            if abs(step[2]) > _MOST_JUMP_RAD:
                raise np.linalg.LinAlgError("the heading jumped too far")
            has_jumped |= is_jump
            chain = let_go(chain, step, is_jump)
            window.replace_last_chain(chain)
            covariance = window.solve()
        steadiness.note(has_jumped)
        self._jumps += bool(has_jumped.any())
        window.take_off_last(self._leaps.let_go((window.x[window.count - 1] - window.x[window.count - 2])[3:]))
        return covariance

    def _fail(self, reason: SceneryReason) -> None:
        self.reasons[reason] += 1
        self._window.reset()
        self.aided.reset()


def _state(found: Answer, pose: CameraPose, corners: int, jumps: int, fit_sigma_rad: float) -> CompassState:
    return CompassState(
        error_rad=found.error_rad,
        covariance_rad2=found.covariance,
        corners=corners,
        jumps=jumps,
        stamp_s=pose.stamp_s,
        lens=found.lens,
        lens_sigma=found.lens_sigma,
        reported=pose,
        landmarks=found.landmarks,
        fit_sigma_rad=fit_sigma_rad,
    )
