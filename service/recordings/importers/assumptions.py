"""What a flight lacks and can be taken for: heights over the sea, home, a fix, an attitude by the course.

Whatever is assumed is a line in the flight's remarks. Free of I/O.
"""

from dataclasses import dataclass, replace

import numpy as np

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import FloatArray
from service.recordings.importers.flight import (
    Attitudes,
    Gimbal,
    ImportedFlight,
    ImportRefusedError,
    Positions,
    unknown,
)
from service.recordings.importers.rows import count, flown, step_deg_of

COURSE_SIGMA_DEG = 20.0  # of a nose that is taken to point along the course, in wind
LEVEL_SIGMA_DEG = 5.0  # of a craft that is taken for level
_LEAST_SPEED_MPS = 2.0  # below, a course says nothing
EARTH_M = 6_371_000.0
_MOST_UNDULATION_M = 120.0
_STEP_TOLD_M = 0.25


@dataclass(frozen=True, slots=True)
class Assumed:
    """What the user allows: `by_course`: nose along the course; heights in metres, None where not given."""

    by_course: bool = False
    geoid_m: float | None = None
    home_alt_m: float | None = None


def completed(flight: ImportedFlight, given: Assumed) -> ImportedFlight:
    """A flight with a place, a height over the sea and home in every row, and an attitude.

    Raises ImportRefusedError where it lacks a place or an attitude that nothing stands in for.
    """
    if flight.positions is None:
        raise ImportRefusedError(
            f"{flight.source}: tells no place: a source with latitude, longitude, height is needed"
        )
    flight = _with_heights(flight, given)
    flight = _with_step(flight)
    flight = _with_velocity(flight)
    flight = _with_home(flight)
    return _with_attitude(flight, given.by_course)


def _with_heights(flight: ImportedFlight, given: Assumed) -> ImportedFlight:
    positions, remarks = flight.positions, flight.remarks
    assert positions is not None
    msl_m = positions.alt_msl_m.copy()
    geoid_m = given.geoid_m
    if geoid_m is None:
        both_m = (positions.alt_ellipsoid_m - msl_m)[np.isfinite(positions.alt_ellipsoid_m - msl_m)]
        if len(both_m) and abs(float(np.median(both_m))) < _MOST_UNDULATION_M:
            geoid_m = float(np.median(both_m))
    if geoid_m is not None:
        msl_m = np.where(np.isfinite(msl_m), msl_m, positions.alt_ellipsoid_m - geoid_m)
    home_m = given.home_alt_m if given.home_alt_m is not None else flight.home[2] if flight.home else None
    if home_m is not None and np.isfinite(home_m):
        msl_m = np.where(np.isfinite(msl_m), msl_m, home_m + positions.above_home_m)
    if given.home_alt_m is not None:  # the user's word counts more than a barometer's
        msl_m = np.where(np.isfinite(positions.above_home_m), given.home_alt_m + positions.above_home_m, msl_m)
    if not np.isfinite(msl_m).any():
        if np.isfinite(positions.alt_ellipsoid_m).any():
            msl_m = positions.alt_ellipsoid_m
            remarks.assumed.append("heights over the ellipsoid are taken as over the sea: --geoid mends that")
        else:
            msl_m = positions.above_home_m
            remarks.assumed.append("heights are over home, whose own is taken as 0: --home-alt mends that")
    is_known = np.isfinite(msl_m)
    count(remarks, "position: no height over the sea", int((~is_known).sum()))
    positions = _kept(replace(positions, alt_msl_m=msl_m), is_known)
    return replace(flight, positions=positions)


def _with_step(flight: ImportedFlight) -> ImportedFlight:
    """With the step of the places' digits, and without places that no flight reaches."""
    positions, step_m = flight.positions, flight.position_step_m
    assert positions is not None
    if step_m is None:
        step_m = float(np.radians(step_deg_of(positions.lat_deg, positions.lon_deg))) * EARTH_M
    if step_m / 2.0 > _STEP_TOLD_M:
        flight.remarks.assumed.append(
            f"places are written in steps of {step_m:.1f} m: they may be off by half of it, to one side all along"
        )
    return replace(flight, positions=flown(positions, step_m, flight.remarks), position_step_m=step_m)


def _with_velocity(flight: ImportedFlight) -> ImportedFlight:
    """By the places where it is not told: the path between them is bent by it."""
    positions = flight.positions
    assert positions is not None
    if np.isfinite(positions.velocity_ned_mps).all():
        return flight
    derived = derived_velocity_mps(positions)
    is_told = np.isfinite(positions.velocity_ned_mps).all(axis=1, keepdims=True)
    if not is_told.any():
        flight.remarks.assumed.append("speeds by the places")
    return replace(
        flight, positions=replace(positions, velocity_ned_mps=np.where(is_told, positions.velocity_ned_mps, derived))
    )


def _with_home(flight: ImportedFlight) -> ImportedFlight:
    """Where none is told, by heights over it, else below the lowest place: the ground is told by it."""
    positions = flight.positions
    assert positions is not None
    home = flight.home
    over_m = positions.alt_msl_m - positions.above_home_m
    if home is None or not np.isfinite(home).all():
        lowest = int(np.argmin(positions.alt_msl_m))
        if np.isfinite(over_m).any():
            home_alt_m = float(np.nanmedian(over_m))
        else:
            home_alt_m = float(positions.alt_msl_m[lowest])
            flight.remarks.assumed.append(
                f"home's height is that of the lowest place, {home_alt_m:.0f} m: with ground.kind = 'flat' the ground's"
            )
        home = (float(positions.lat_deg[lowest]), float(positions.lon_deg[lowest]), home_alt_m)
    above_m = np.where(np.isfinite(positions.above_home_m), positions.above_home_m, positions.alt_msl_m - home[2])
    return replace(flight, home=home, positions=replace(positions, above_home_m=above_m))


def _with_attitude(flight: ImportedFlight, by_course: bool) -> ImportedFlight:
    """`craft` is what the recording's attitudes will be: the craft's, or, where only that is known, the camera's."""
    craft, gimbal, camera = flight.craft, flight.gimbal, flight.camera
    if camera is None and gimbal is not None and gimbal.yaw_from == "earth":
        camera = gimbal.attitudes
    if craft is not None and camera is not None:
        return replace(flight, gimbal=Gimbal(camera, "earth"), camera=None)
    if craft is not None:
        return flight
    if camera is not None:
        flight.remarks.assumed.append("the camera's attitude stands for the craft's, the mount's angles are 0")
        return replace(flight, craft=camera, gimbal=None, camera=None)
    if not by_course:
        why = next((f" ({one})" for one in flight.remarks.dropped if "not told" in one), "")
        raise ImportRefusedError(
            f"{flight.source}: tells no attitude{why}: give --attitude FILE (a table of time, yaw_deg, pitch_deg, "
            "roll_deg, or another log), or --by-course with --mount and --mount-sigma: the nose along the course, level"
        )
    assert flight.positions is not None
    craft = course_attitudes(flight.positions)
    if craft is None:
        raise ImportRefusedError(f"{flight.source}: is never faster than {_LEAST_SPEED_MPS:g} m/s: it has no course")
    flight.remarks.assumed.append(
        f"level, the nose along the course: heading sigma {COURSE_SIGMA_DEG:g} deg, tilt {LEVEL_SIGMA_DEG:g} deg"
    )
    return replace(flight, craft=craft, yaw_sigma_deg=COURSE_SIGMA_DEG, tilt_sigma_deg=LEVEL_SIGMA_DEG)


def course_attitudes(positions: Positions) -> Attitudes | None:
    """Level, the nose along the velocity, at the places where that is fast enough; None where it nowhere is."""
    north_mps, east_mps, _ = positions.velocity_ned_mps.T
    is_fast = np.hypot(north_mps, east_mps) > _LEAST_SPEED_MPS
    if not is_fast.any():
        return None
    yaw_rad = np.arctan2(east_mps, north_mps)[is_fast]
    q = quaternion_from_euler(yaw_rad, np.zeros(len(yaw_rad)), np.zeros(len(yaw_rad))).T
    return Attitudes(positions.time_s[is_fast], q, unknown(len(q), 3))


def derived_velocity_mps(positions: Positions) -> FloatArray:
    """Velocities (N, 3) north, east, down by differences of the places; 0 of a single one."""
    if len(positions.time_s) < 2:
        return np.zeros((len(positions.time_s), 3))
    degrees = (positions.lat_deg, np.unwrap(positions.lon_deg, period=360.0))
    north_mps, east_mps = (np.gradient(np.radians(one) * EARTH_M, positions.time_s) for one in degrees)
    down_mps = -np.gradient(positions.alt_msl_m, positions.time_s)
    return np.stack([north_mps, east_mps * np.cos(np.radians(positions.lat_deg)), down_mps], axis=1)


def _kept(positions: Positions, is_kept: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Positions:
    return Positions(**{name: getattr(positions, name)[is_kept] for name in Positions.__dataclass_fields__})
