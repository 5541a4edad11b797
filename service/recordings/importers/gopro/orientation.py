"""A GoPro's own orientation (CORI, IORI, GRAV) to the picture's attitude; where north is it does not know. Free of I/O.

What the quaternions turn is not in the format's description; a HERO11's own streams tell it: by its gyroscope and its
accelerometer the camera's axes are right, down, forward; CORI, w first, turns the axes at the start into the camera's;
IORI turns the camera's into the picture's, and with it the picture's turning is 20 times smoother than the camera's, as
its stabilisation makes it.
"""

from dataclasses import dataclass

import numpy as np

from distloc.geometry.rotations import R_FRD_FROM_CAM, matrix_from_quaternion, quaternion_from_euler
from distloc.types import BoolArray, FloatArray
from service.recordings.importers.assumptions import COURSE_SIGMA_DEG, course_attitudes, derived_velocity_mps
from service.recordings.importers.flight import Attitudes, Positions, Remarks
from service.recordings.importers.gopro.series import Series
from service.recordings.importers.rows import attitudes_of

TILT_SIGMA_DEG = 2.0  # gravity by an accelerometer in flight
_MOST_SPREAD_DEG = 5.0  # of gravity over a film: more, and the streams are not what they are taken for
_LEAST_COURSES = 10


@dataclass(frozen=True, slots=True)
class OwnOrientation:
    """The picture's attitude from north, and one standard deviation of its heading and its tilt."""

    attitudes: Attitudes
    yaw_sigma_deg: float
    tilt_sigma_deg: float


def camera_attitudes(
    series: dict[str, Series], frames_s: FloatArray, positions: Positions | None, by_course: bool, remarks: Remarks
) -> OwnOrientation | None:
    """None, with the reason in the remarks, where the streams lack or disagree, or nobody allows the course."""
    if "CORI" not in series or "GRAV" not in series:
        remarks.lacks.append("the camera's orientation (CORI and GRAV): HERO8 and later write it")
        return None
    if not by_course or positions is None:
        remarks.lacks.append("where north is: the camera's own orientation counts from its start")
        return None
    level = _level(series, frames_s, remarks)
    if level is None:
        return None
    times_s, R_level_from_body = level
    heading = _heading_offset(times_s, R_level_from_body, positions)
    if heading is None:
        remarks.lacks.append("a course that tells where north is: it hardly moves, or its orientation does not follow")
        return None
    offset_rad, spread_deg = heading
    turn = matrix_from_quaternion(quaternion_from_euler(offset_rad, 0.0, 0.0))
    attitudes = attitudes_of(times_s, _quaternions(turn @ R_level_from_body), remarks, name="camera's orientation")
    if attitudes is None:
        return None
    yaw_sigma_deg = float(np.hypot(COURSE_SIGMA_DEG, spread_deg))
    remarks.assumed.append(
        f"the camera's own orientation, looking along the course on the whole: heading sigma {yaw_sigma_deg:.0f} deg"
    )
    return OwnOrientation(attitudes, yaw_sigma_deg, TILT_SIGMA_DEG)


def _level(series: dict[str, Series], frames_s: FloatArray, remarks: Remarks) -> tuple[FloatArray, FloatArray] | None:
    """Times (N,) and rotations (N, 3, 3) of the picture's forward, right, down to axes of which the third is down."""
    cori, grav, iori = series["CORI"], series["GRAV"], series.get("IORI")
    count = min(cori.count, grav.count, iori.count if iori is not None else cori.count)
    if cori.values.shape[1] != 4 or grav.values.shape[1] != 3 or (iori is not None and iori.values.shape[1] != 4):
        remarks.lacks.append("the camera's orientation: its streams have other columns than known")
        return None
    is_good = _is_unit(cori.values[:count]) & _is_unit(grav.values[:count])
    if iori is not None:
        is_good &= _is_unit(iori.values[:count])
    # a frame has one of each; where there are not as many, they are taken as even
    times_s = frames_s[:count] if cori.count == len(frames_s) else cori.even_times_s()[:count]
    R_start_from_cam = _matrices(cori.values[:count][is_good]).transpose(0, 2, 1)
    gravity = np.einsum("nij,nj->ni", R_start_from_cam, grav.values[:count][is_good])
    if not len(gravity):
        return None
    down = gravity.mean(axis=0)
    off_deg = np.degrees(
        np.arcsin(np.clip(np.linalg.norm(np.cross(gravity, down / np.linalg.norm(down)), axis=1), 0, 1))
    )
    if float(np.median(off_deg)) > _MOST_SPREAD_DEG:
        remarks.lacks.append(f"the camera's orientation: by it gravity wanders by {float(np.median(off_deg)):.0f} deg")
        return None
    R = _level_from_start(down / np.linalg.norm(down)) @ R_start_from_cam
    if iori is not None:
        R = R @ _matrices(iori.values[:count][is_good]).transpose(0, 2, 1)
    return times_s[is_good], R @ R_FRD_FROM_CAM.T


def _level_from_start(down: FloatArray) -> FloatArray:
    """Rows: two level axes and down, in the axes at the start."""
    least = np.eye(3)[int(np.argmin(np.abs(down)))]
    first = np.cross(least, down)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(down, first), down])


def _heading_offset(times_s: FloatArray, R: FloatArray, positions: Positions) -> tuple[float, float] | None:
    """What to add to the headings of R so that they follow the course on the whole, and their spread in degrees."""
    velocity = positions.velocity_ned_mps
    is_told = np.isfinite(velocity).all()
    heights = np.where(np.isfinite(positions.alt_msl_m), positions.alt_msl_m, positions.alt_ellipsoid_m)
    level = Positions(
        positions.time_s,
        positions.lat_deg,
        positions.lon_deg,
        heights,
        positions.alt_ellipsoid_m,
        positions.above_home_m,
        velocity,
    )
    moving = level if is_told else _smoothed(level)
    course = course_attitudes(moving)
    if course is None or len(course.time_s) < _LEAST_COURSES:
        return None
    nearest = np.clip(np.searchsorted(times_s, course.time_s), 0, len(times_s) - 1)
    headings = np.arctan2(R[nearest, 1, 0], R[nearest, 0, 0])
    courses = 2.0 * np.arctan2(course.q_ned_from_body[:, 3], course.q_ned_from_body[:, 0])
    mean = np.exp(1j * (courses - headings)).mean()
    if abs(mean) < 0.5:
        return None
    return float(np.angle(mean)), float(np.degrees(np.sqrt(-2.0 * np.log(min(1.0, abs(mean))))))


def _smoothed(positions: Positions) -> Positions:
    """With velocities by the places a second apart."""
    step = (
        max(1, round(0.5 / max(1e-3, float(np.median(np.diff(positions.time_s)))))) if len(positions.time_s) > 1 else 1
    )
    kept = {name: getattr(positions, name)[::step] for name in Positions.__dataclass_fields__}
    thin = Positions(**kept)
    return Positions(**{**kept, "velocity_ned_mps": derived_velocity_mps(thin)})


def _is_unit(values: FloatArray) -> BoolArray:
    norm = np.linalg.norm(values, axis=1)
    return np.asarray(np.isfinite(norm) & (np.abs(norm - 1.0) < 0.1))


def _matrices(q: FloatArray) -> FloatArray:
    return np.stack([matrix_from_quaternion(one) for one in q]) if len(q) else np.zeros((0, 3, 3))


def _quaternions(R: FloatArray) -> FloatArray:
    """Unit quaternions (N, 4), w first, of rotations (N, 3, 3)."""
    yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    pitch = np.arcsin(np.clip(-R[:, 2, 0], -1.0, 1.0))
    roll = np.arctan2(R[:, 2, 1], R[:, 2, 2])
    return np.stack(
        [quaternion_from_euler(*(float(one) for one in angles)) for angles in zip(yaw, pitch, roll, strict=True)]
    )
