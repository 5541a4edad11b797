"""The autopilot of a GoPro Karma, in its camera's telemetry: attitude, place and its gimbal's turn. Free of I/O.

Its stamps are on clocks of their own. Samples came within the payload that has them, some tenths of a second after
their stamp: that ties their clock to the film's, late by as much.
"""

import numpy as np

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import FloatArray
from service.recordings.importers.flight import (
    Attitudes,
    Film,
    Fixes,
    Gimbal,
    ImportedFlight,
    Lens,
    Positions,
    Remarks,
    unknown,
)
from service.recordings.importers.gopro.series import Series
from service.recordings.importers.rows import attitudes_of, fixes_of, positions_of

TIED_WITHIN_S = 0.6  # of samples on their way from autopilot to camera
GIMBAL_TILT_SIGMA_DEG = 3.0
_GIMBAL_WIDTH, _GIMBAL_YAW = 8, 7
_ATTITUDE_WIDTH, _POSITION_WIDTH, _FIX_WIDTH = 7, 9, 10


def karma_part(name: str, series: dict[str, Series], lens: Lens, film: Film, remarks: Remarks) -> ImportedFlight:
    """The flight on the film's clock, which the turning of the frames may tie better."""
    craft = _craft(series["ATTD"], remarks)
    gimbal = _gimbal(series.get("CYTS"), remarks)
    remarks.assumed.append(
        f"the autopilot's stamps are on the film's clock by when they came, up to {TIED_WITHIN_S:.1f} s late"
    )
    return ImportedFlight(
        source=name,
        epoch_s=_epoch_s(series.get("SYST")),
        positions=_positions(series, remarks),
        craft=craft,
        gimbal=None if gimbal is None else Gimbal(gimbal, "vehicle"),
        fixes=_fixes(series.get("GPRI"), remarks),
        lens=Lens(lens.width, lens.height),
        frames=film,
        frames_tied=False,
        tied_within_s=TIED_WITHIN_S,
        tilt_sigma_deg=GIMBAL_TILT_SIGMA_DEG if gimbal is not None else None,
        remarks=remarks,
    )


def _film_times_s(one: Series, stamps_s: FloatArray) -> FloatArray:
    return stamps_s + one.clock_tie(stamps_s)[0]


def _craft(one: Series, remarks: Remarks) -> Attitudes | None:
    """ATTD: seconds since boot, roll, pitch, yaw in radians, and their rates."""
    values = one.values
    if values.shape[1] < _ATTITUDE_WIDTH:
        remarks.lacks.append(f"the craft's attitude: ATTD has {values.shape[1]} columns")
        return None
    q = _quaternions(values[:, 3], values[:, 2], values[:, 1])
    return attitudes_of(_film_times_s(one, values[:, 0]), q, remarks, values[:, 4:7], "craft's attitude")


def _gimbal(one: Series | None, remarks: Remarks) -> Attitudes | None:
    """CYTS has the gimbal's turn from the nose last: added to the craft's yaw it gives a heading that stands still."""
    if one is None or one.values.shape[1] < _GIMBAL_WIDTH:
        remarks.lacks.append("the gimbal's angles (CYTS)")
        return None
    yaw = one.values[:, _GIMBAL_YAW]
    zero = np.zeros(len(yaw))
    remarks.assumed.append("the gimbal holds the camera level, as its pitch is not told: --mount mends that")
    times_s = _film_times_s(one, one.values[:, 0])
    return attitudes_of(times_s, _quaternions(yaw, zero, zero), remarks, name="gimbal")


def _positions(series: dict[str, Series], remarks: Remarks) -> Positions | None:
    """GLPI, the estimator's; the receiver's GPRI where that lacks."""
    one = series.get("GLPI")
    if one is not None and one.values.shape[1] >= _POSITION_WIDTH:
        v = one.values
        times_s = _film_times_s(one, v[:, 0])
        return positions_of(
            times_s,
            v[:, 1],
            v[:, 2],
            remarks,
            alt_msl_m=v[:, 3],
            above_home_m=v[:, 4],
            velocity_ned_mps=v[:, 5:8],
        )
    one = series.get("GPRI")
    if one is None or one.values.shape[1] < _FIX_WIDTH:
        return None
    return positions_of(
        _film_times_s(one, one.values[:, 0]), one.values[:, 1], one.values[:, 2], remarks, alt_msl_m=one.values[:, 3]
    )


def _fixes(one: Series | None, remarks: Remarks) -> Fixes | None:
    if one is None or one.values.shape[1] < _FIX_WIDTH:
        return None
    v = one.values
    times_s = _film_times_s(one, v[:, 0])
    return fixes_of(times_s, v[:, 8], remarks, satellites=v[:, 9], h_acc_m=v[:, 4], v_acc_m=v[:, 5])


def _epoch_s(one: Series | None) -> float | None:
    """SYST: seconds since boot, and UTC."""
    if one is None or one.values.shape[1] < 2:
        return None
    offsets = one.values[:, 1] - _film_times_s(one, one.values[:, 0])
    offsets = offsets[np.isfinite(offsets) & (offsets > 0.0) & (offsets < 4_102_444_800.0)]
    return float(np.median(offsets)) if len(offsets) else None


def _quaternions(yaw_rad: FloatArray, pitch_rad: FloatArray, roll_rad: FloatArray) -> FloatArray:
    out = unknown(len(yaw_rad), 4)
    for i, angles in enumerate(zip(yaw_rad, pitch_rad, roll_rad, strict=True)):
        if np.isfinite(angles).all():
            out[i] = quaternion_from_euler(*(float(one) for one in angles))
    return out
