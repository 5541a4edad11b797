"""Judges whether the autopilot's position and attitude may be used, and counts why not; used by the autopilot."""

import math
from typing import Any

from distloc.types import RejectReason

EKF_NEEDED = 1 | 2 | 4 | 16 | 32  # attitude, both velocities, absolute horizontal and vertical position
EKF_REFUSED = 128 | 1024  # constant position mode, uninitialised
EKF_GLITCH = 32768
ESTIMATOR_REFUSED = 128 | 1024 | 2048  # PX4's: constant position mode, GPS glitch, accelerometer error
EKF_AGE_NS = 10_000_000_000
FIX_3D = 3
NULL_ISLAND_DEG = 1e-3
HEIGHT_M = (-1_000.0, 50_000.0)


class Health:
    """What the autopilot last said of its estimator and its GPS; of two words on the estimate the worse counts."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything: the autopilot restarted."""
        self.ekf_flags: int | None = None
        self.estimator_flags: int | None = None
        self.fix_type: int | None = None
        self._ekf_ns = self._estimator_ns = 0

    def ekf(self, message: Any, now_ns: int) -> None:
        """Take an EKF_STATUS_REPORT."""
        self.ekf_flags, self._ekf_ns = int(message.flags), now_ns

    def estimator(self, message: Any, now_ns: int) -> None:
        """Take an ESTIMATOR_STATUS, PX4's word on the same."""
        self.estimator_flags, self._estimator_ns = int(message.flags), now_ns

    def gps(self, message: Any) -> None:
        """Take a GPS_RAW_INT."""
        self.fix_type = int(message.fix_type)

    def is_ekf_degraded(self) -> bool:
        """Whether the estimator says that it is unhealthy or that GPS glitches."""
        ekf, estimator = self.ekf_flags, self.estimator_flags
        is_ekf_poor = ekf is not None and (not _is_nominal(ekf, EKF_REFUSED) or bool(ekf & EKF_GLITCH))
        return is_ekf_poor or (estimator is not None and not _is_nominal(estimator, ESTIMATOR_REFUSED))

    def position_fault(self, lat_deg: float, lon_deg: float, alt_m: float, now_ns: int) -> RejectReason | None:
        """Why a position in degrees and metres may not be used; the estimator's word counts above the fix."""
        if not math.isfinite(lat_deg + lon_deg + alt_m) or abs(lat_deg) > 90 or abs(lon_deg) > 180:
            return RejectReason.POSITION_INVALID
        words = [
            _is_nominal(flags, refused)
            for flags, refused, heard_ns in (
                (self.ekf_flags, EKF_REFUSED, self._ekf_ns),
                (self.estimator_flags, ESTIMATOR_REFUSED, self._estimator_ns),
            )
            if flags is not None and now_ns - heard_ns <= EKF_AGE_NS
        ]
        if not all(words):
            return RejectReason.EKF_UNHEALTHY
        if not words and (self.fix_type is None or self.fix_type < FIX_3D):
            return RejectReason.NO_FIX
        is_null = abs(lat_deg) < NULL_ISLAND_DEG and abs(lon_deg) < NULL_ISLAND_DEG
        return RejectReason.POSITION_INVALID if is_null or not HEIGHT_M[0] < alt_m < HEIGHT_M[1] else None


def _is_nominal(flags: int, refused: int) -> bool:
    return flags & EKF_NEEDED == EKF_NEEDED and not flags & refused
