"""The values that pass between the algorithm's parts and to its callers.

Axes: `enu` is east, north, up in metres about a local origin; `cam` is x right, y down, z forward (OpenCV).
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from distloc.backports import StrEnum

FloatArray = NDArray[np.float64]
MaskArray = NDArray[np.uint8] | NDArray[np.bool_]
BoolArray = NDArray[np.bool_]


class TargetState(StrEnum):
    """The life of a track: seen, believed, believed but not seen now, given up."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    DISMISSED = "dismissed"


class RejectReason(StrEnum):
    """Why a measurement or a frame was not used; each is counted in the status."""

    NO_FIX = "no_fix"
    EKF_UNHEALTHY = "ekf_unhealthy"
    POSITION_INVALID = "position_invalid"
    POSITION_JUMPED = "position_jumped"
    ATTITUDE_INVALID = "attitude_invalid"
    TURNING = "turning"
    NO_CLOCK = "no_clock"
    NO_POSE = "no_pose"
    STALE_POSE = "stale_pose"
    POSE_GAP = "pose_gap"
    FRAME_TOO_OLD = "frame_too_old"
    GIMBAL_UNKNOWN = "gimbal_unknown"
    ZOOMED = "zoomed"
    FRAME_MISSING = "frame_missing"
    BAD_FRAME = "bad_frame"
    FROZEN_FRAME = "frozen_frame"
    BLIND_FRAME = "blind_frame"
    SEGMENTATION_FAILED = "segmentation_failed"
    SEGMENTATION_FLOODED = "segmentation_flooded"
    ONE_VIEW = "one_view"
    NO_BASELINE = "no_baseline"
    BEHIND_CAMERA = "behind_camera"
    ALL_OUTLIERS = "all_outliers"


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """One standard deviation of each error of a reported pose.

    Biases last: Gauss-Markov about up (heading) and about east and north (tilt) with one time constant; where a craft's
    heading is known, its turn by `bias_turn_rad` makes them forget themselves as much as that time: iron in the craft
    makes a compass err by the heading, so a turn brings another error. White errors are each frame's own; the
    position's is on each axis. docs/python.md has what to give. `heading_scale` is how many times as large as told the
    heading's was made, where the targets' bearings show that it is.
    """

    heading_bias_rad: float
    tilt_bias_rad: float
    attitude_white_rad: float
    position_m: float
    bias_time_constant_s: float
    bias_turn_rad: float = float("inf")
    position_bias_m: float = 1.5
    focal_sigma: float = 0.0
    heading_scale: float = 1.0

    @property
    def bias_variance(self) -> FloatArray:
        """Of the attitude's bias (3, 3), about east, north and up."""
        return np.diag(np.square([self.tilt_bias_rad, self.tilt_bias_rad, self.heading_bias_rad]))


@dataclass(frozen=True, slots=True)
class AttitudeError:
    """What is still wrong of a pose's attitude, as a rotation vector about east, north and up.

    `covariance` (3, 3) is its own. Of the error at the step before it keeps `kept` (3, 3), and `new` (3, 3) is the
    covariance of what comes in. `source` says whose attitude it is. Where the scenery takes over, that holds for the
    autopilot's error, of which `found_rad` (3,) is then known and taken off: what is left has `covariance`. While the
    scenery `is_about_to_tell`, nothing is believed by the autopilot's word alone.
    """

    covariance: FloatArray
    kept: FloatArray
    new: FloatArray
    source: Literal["scenery", "autopilot"]
    found_rad: FloatArray | None = None
    is_about_to_tell: bool = False


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Where the camera was and how it was turned when a frame was exposed.

    `position_enu_m` is (3,); `R_cam_from_enu` is (3, 3): `R_cam_from_enu @ v_enu` gives `v_cam`. `errors` are this
    pose's own where they are known, else those of the localizer's config hold. `heading_rad` is the craft's (not the
    camera's), clockwise from north: the compass errs by it, and so otherwise once the craft has turned. Without it the
    camera's azimuth stands in once that has turned by over 30 degrees. `platform` names who carries the camera: each
    has slow errors of its own. `LocalizerConfig.platforms` is how many names there may be.
    """

    stamp_s: float
    position_enu_m: FloatArray
    R_cam_from_enu: FloatArray
    errors: PoseErrors | None = None
    heading_rad: float | None = None
    attitude: AttitudeError | None = None
    platform: str = ""


@dataclass(frozen=True, slots=True)
class Root:
    """A segment's lowest band, a plume's foot: its width, and one standard deviation of its middle.

    `lean` is how far the smoke right over it goes to the right for each pixel up.
    """

    width_px: float
    sigma_px: float
    lean: float


@dataclass(frozen=True, slots=True)
class Detection:
    """One segment of a mask, in the camera's full-size pixels (centres of pixels at whole numbers).

    `centre_px` and `base_px` are (u, v); `covariance_px2` is (2, 2), the segment's second moments. `centre_px` is the
    middle of its bounding box, which holes and missing parts inside it do not move; `base_px` that of its root, the
    lowest band, at its lower edge. `sigma_px` is one standard deviation of the centre. Where the segment
    `touches_border`, `is_cut` says which axes of its box, across and upright, go on beyond the image, and `is_base_cut`
    the same of the root.
    """

    centre_px: FloatArray
    base_px: FloatArray
    covariance_px2: FloatArray
    area_px: float
    width_px: float
    height_px: float
    sigma_px: float
    touches_border: bool = False
    is_point: bool = False  # of no known size: width and height are those of its sigma
    is_cut: tuple[bool, bool] = (True, True)
    is_base_cut: tuple[bool, bool] = (True, True)
    root: Root | None = None

    @classmethod
    def from_point(cls, u_px: float, v_px: float, sigma_px: float) -> "Detection":
        """A detection known only as a point: a click, a box's centre, a bearing."""
        if not (np.isfinite([u_px, v_px, sigma_px]).all() and sigma_px > 0):
            raise ValueError(f"u_px, v_px must be finite and sigma_px > 0, got {u_px}, {v_px}, {sigma_px}")
        point = np.array([u_px, v_px], dtype=np.float64)
        size = 2.0 * sigma_px
        return cls(point, point, np.eye(2) * sigma_px**2, np.pi * sigma_px**2, size, size, sigma_px, is_point=True)


@dataclass(frozen=True, slots=True)
class Ellipse:
    """An ellipse on the map: semi-axes in metres, the major axis' azimuth clockwise from north in [0, pi)."""

    semi_major_m: float
    semi_minor_m: float
    azimuth_rad: float


@dataclass(frozen=True, slots=True)
class Extent:
    """The plume's size as the camera sees it, across and up, with one standard deviation of each."""

    width_m: float
    width_sigma_m: float
    height_m: float
    height_sigma_m: float


@dataclass(frozen=True, slots=True)
class Plume:
    """The smoke over a fire: its middle (3,), how far it leans off the vertical, and where to, clockwise from north."""

    centre_enu_m: FloatArray
    lean_rad: float
    drift_rad: float


@dataclass(frozen=True, slots=True)
class TargetEstimate:
    """What is known of one target after a step.

    `position_enu_m` is (3,), `covariance_enu_m2` (3, 3). `ellipse95` holds 95 % of the weight, `region95` the object as
    well; `vertical95_m` is the half-width of the central 95 % in height; `range95_m` that of the slant range.
    `attitude` says whose the pose's was at this step, `heading_sigma_rad` how sure its heading; `motion` whether it
    stands, a fire whose front may creep, or what drives or floats. With the aim at its base a target has a `plume`.
    """

    id: int
    state: TargetState
    position_enu_m: FloatArray
    covariance_enu_m2: FloatArray
    ellipse95: Ellipse
    vertical95_m: float
    region95: Ellipse
    extent: Extent
    range_m: float
    range95_m: tuple[float, float]
    bearing_rad: float
    existence: float
    observations: int
    misses: int
    baseline_m: float
    first_seen_s: float
    last_seen_s: float
    aim: str = "centre"
    attitude: Literal["scenery", "autopilot"] = "autopilot"
    heading_sigma_rad: float = 0.0
    motion: Literal["fixed", "unresolved", "moving"] = "fixed"
    plume: Plume | None = None
    degraded: tuple[str, ...] = field(default=())


def after(before: AttitudeError, now: AttitudeError) -> AttitudeError:
    """What an attitude's error keeps and what is new over two steps; nothing may be found in the first."""
    kept, new = now.kept @ before.kept, now.kept @ before.new @ now.kept.T + now.new
    return AttitudeError(now.covariance, kept, new, now.source, now.found_rad, now.is_about_to_tell)
