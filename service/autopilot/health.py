"""Judges whether the autopilot's position and attitude may be used, and counts why not; used by the autopilot."""

import math
from typing import Any

from distloc.types import RejectReason

EKF_NEEDED = 1 | 2 | 4 | 16 | 32  # attitude, both velocities, absolute horizontal and vertical position
EKF_REFUSED = 128 | 1024  # constant position mode, uninitialised
EKF_GLITCH = 32768
EKF_AGE_NS = 10_000_000_000
FIX_3D = 3
NULL_ISLAND_DEG = 1e-3
HEIGHT_M = (-1_000.0, 50_000.0)


class Health:
    """What the autopilot last said of its estimator and its GPS."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget everything: the autopilot restarted."""
        self.ekf_flags: int | None = None
        self.fix_type: int | None = None
        self._ekf_ns = 0

    def ekf(self, message: Any, now_ns: int) -> None:
        """Take an EKF_STATUS_REPORT."""
        self.ekf_flags, self._ekf_ns = int(message.flags), now_ns

    def gps(self, message: Any) -> None:
        """Take a GPS_RAW_INT."""
        self.fix_type = int(message.fix_type)

    def is_ekf_degraded(self) -> bool:
        """Whether the estimator says that it is unhealthy or that GPS glitches."""
        flags = self.ekf_flags
        return flags is not None and (not _is_nominal(flags) or bool(flags & EKF_GLITCH))

    def position_fault(self, lat_deg: float, lon_deg: float, alt_m: float, now_ns: int) -> RejectReason | None:
        """Why a position in degrees and metres may not be used; the estimator's word counts above the fix."""
        if not math.isfinite(lat_deg + lon_deg + alt_m) or abs(lat_deg) > 90 or abs(lon_deg) > 180:
            return RejectReason.POSITION_INVALID
        if self.ekf_flags is not None and now_ns - self._ekf_ns <= EKF_AGE_NS:
            if not _is_nominal(self.ekf_flags):
                return RejectReason.EKF_UNHEALTHY
        elif self.fix_type is None or self.fix_type < FIX_3D:
            return RejectReason.NO_FIX
        is_null = abs(lat_deg) < NULL_ISLAND_DEG and abs(lon_deg) < NULL_ISLAND_DEG
        return RejectReason.POSITION_INVALID if is_null or not HEIGHT_M[0] < alt_m < HEIGHT_M[1] else None


def _is_nominal(flags: int) -> bool:
    return flags & EKF_NEEDED == EKF_NEEDED and not flags & EKF_REFUSED
