"""The vehicle's recent attitudes and positions and its pose at any time between; used by the autopilot.

Times are the autopilot's time since boot in nanoseconds. Memory is fixed.
"""

import math
from typing import Any

import numpy as np

from distloc.geometry.rotations import quaternion_from_euler, slerp
from distloc.types import FloatArray, RejectReason

WAIT_NS = 200_000_000
ATTITUDE_GAP_NS = 200_000_000
POSITION_GAP_NS = 1_000_000_000
ATTITUDE_AHEAD_NS = 100_000_000
POSITION_AHEAD_NS = 500_000_000
FUTURE_NS = 1_000_000_000


class Track:
    """Samples (n,) in rising time; adding one newer than the last is all that changes it."""

    def __init__(self, capacity: int, width: int, gap_ns: int, ahead_ns: int) -> None:
        if capacity < 2 or gap_ns <= 0 or ahead_ns < 0:
            raise ValueError(f"capacity >= 2, gap_ns > 0, ahead_ns >= 0 wanted, got {capacity}, {gap_ns}, {ahead_ns}")
        self.gap_ns = gap_ns
        self.ahead_ns = ahead_ns
        self._capacity = capacity
        self._stamps_ns = np.zeros(2 * capacity, dtype=np.int64)
        self._values = np.zeros((2 * capacity, width))
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._used = 0
        self._evicted = False

    @property
    def count(self) -> int:
        """How many samples are held."""
        return min(self._used, self._capacity)

    @property
    def latest_ns(self) -> int | None:
        """Time of the newest sample."""
        return int(self._stamps_ns[self._used - 1]) if self._used else None

    def add(self, stamp_ns: int, value: FloatArray) -> bool:
        """Keep a sample; False if it is not newer than the last."""
        latest_ns = self.latest_ns
        if latest_ns is not None and stamp_ns <= latest_ns:
            return False
        if self._used == 2 * self._capacity:
            self._stamps_ns[: self._capacity] = self._stamps_ns[self._capacity :]
            self._values[: self._capacity] = self._values[self._capacity :]
            self._used, self._evicted = self._capacity, True
        self._stamps_ns[self._used] = stamp_ns
        self._values[self._used] = value
        self._used += 1
        return True

    def around(self, stamp_ns: int, now_ns: int) -> tuple[int, int] | RejectReason | None:  # noqa: PLR0911
        """Indices of the samples to interpolate (or, the same two, to extrapolate) from; None: wait for a later one."""
        latest_ns = self.latest_ns
        if stamp_ns > now_ns + FUTURE_NS:
            return RejectReason.STALE_POSE
        if latest_ns is None or stamp_ns > latest_ns:
            if now_ns - stamp_ns < WAIT_NS:
                return None
            if latest_ns is None:
                return RejectReason.NO_POSE
            if stamp_ns - latest_ns > self.ahead_ns:
                return RejectReason.STALE_POSE
            return max(self._used - 2, 0), self._used - 1
        after = int(np.searchsorted(self._stamps_ns[: self._used], stamp_ns))
        if self._stamps_ns[after] == stamp_ns:
            return after, after
        if after == 0:
            return RejectReason.FRAME_TOO_OLD if self._evicted else RejectReason.NO_POSE
        if self._stamps_ns[after] - self._stamps_ns[after - 1] > self.gap_ns:
            return RejectReason.POSE_GAP
        return after - 1, after

    def sample(self, index: int) -> tuple[int, FloatArray]:
        """Time and value of one sample."""
        return int(self._stamps_ns[index]), self._values[index]


class AttitudeTrack(Track):
    """Unit quaternions w, x, y, z over time."""

    def __init__(self, capacity: int = 1024, gap_ns: int = ATTITUDE_GAP_NS, ahead_ns: int = ATTITUDE_AHEAD_NS) -> None:
        super().__init__(capacity, 4, gap_ns, ahead_ns)

    def at(self, stamp_ns: int, now_ns: int) -> FloatArray | RejectReason | None:
        """Quaternion (4,) by slerp; a last sample that stands alone after a gap is held, not extrapolated."""
        pair = self.around(stamp_ns, now_ns)
        if not isinstance(pair, tuple):
            return pair
        (start_ns, q_start), (end_ns, q_end) = self.sample(pair[0]), self.sample(pair[1])
        if start_ns == end_ns or end_ns - start_ns > self.gap_ns:
            return q_end.copy()
        return slerp(q_start, q_end, (stamp_ns - start_ns) / (end_ns - start_ns))


class PositionTrack(Track):
    """Positions and velocities over time: rows of x, y, z, vx, vy, vz."""

    def __init__(self, capacity: int = 512, gap_ns: int = POSITION_GAP_NS, ahead_ns: int = POSITION_AHEAD_NS) -> None:
        super().__init__(capacity, 6, gap_ns, ahead_ns)

    @property
    def velocity_enu_mps(self) -> FloatArray | None:
        """The newest (3,); None where there is none."""
        return self._values[self._used - 1, 3:].copy() if self._used else None

    def at(self, stamp_ns: int, now_ns: int) -> FloatArray | RejectReason | None:
        """Position (3,) by cubic Hermite between samples, by the last velocity after them."""
        pair = self.around(stamp_ns, now_ns)
        if not isinstance(pair, tuple):
            return pair
        (start_ns, start), (end_ns, end) = self.sample(pair[0]), self.sample(pair[1])
        if start_ns == end_ns or stamp_ns > end_ns:
            return np.asarray(end[:3] + end[3:] * ((stamp_ns - end_ns) * 1e-9))
        return _hermite(start, end, (end_ns - start_ns) * 1e-9, (stamp_ns - start_ns) / (end_ns - start_ns))


class PoseHistory:
    """Attitudes and positions together; limits may be widened for slow old links."""

    def __init__(
        self,
        attitude_gap_ns: int = ATTITUDE_GAP_NS,
        position_gap_ns: int = POSITION_GAP_NS,
        attitude_capacity: int = 1024,
        position_capacity: int = 512,
    ) -> None:
        self.attitudes = AttitudeTrack(attitude_capacity, attitude_gap_ns)
        self.positions = PositionTrack(position_capacity, position_gap_ns)

    @property
    def attitude_count(self) -> int:
        """How many attitudes are held."""
        return self.attitudes.count

    @property
    def position_count(self) -> int:
        """How many positions are held."""
        return self.positions.count

    @property
    def latest(self) -> tuple[int | None, int | None]:
        """Times of the newest attitude and of the newest position."""
        return self.attitudes.latest_ns, self.positions.latest_ns

    def clear(self) -> None:
        """Forget everything."""
        self.attitudes.clear()
        self.positions.clear()

    def add_attitude(self, boot_ns: int, q_ned_from_body: FloatArray) -> bool:
        """Keep a unit quaternion (4,) w, x, y, z; False if it is not newer than the last."""
        return self.attitudes.add(boot_ns, q_ned_from_body)

    def add_position(self, boot_ns: int, position_enu_m: FloatArray, velocity_enu_mps: FloatArray) -> bool:
        """Keep a position (3,) and velocity (3,); False if it is not newer than the last."""
        return self.positions.add(boot_ns, np.concatenate([position_enu_m, velocity_enu_mps]))

    def lookup(self, boot_ns: int, now_boot_ns: int) -> tuple[FloatArray, FloatArray] | RejectReason | None:
        """Quaternion (4,) and position (3,) at `boot_ns`; None: a later sample may still come."""
        q_ned_from_body = self.attitudes.at(boot_ns, now_boot_ns)
        position_enu_m = self.positions.at(boot_ns, now_boot_ns)
        for part in (q_ned_from_body, position_enu_m):
            if isinstance(part, RejectReason):
                return part
        if not isinstance(q_ned_from_body, np.ndarray) or not isinstance(position_enu_m, np.ndarray):
            return None
        return q_ned_from_body, position_enu_m


def _hermite(start: FloatArray, end: FloatArray, span_s: float, share: float) -> FloatArray:
    """Position (3,) at `share` of a span; the usual cubic Hermite basis."""
    s2, s3 = share * share, share**3
    return np.asarray(
        (2 * s3 - 3 * s2 + 1) * start[:3]
        + (s3 - 2 * s2 + share) * span_s * start[3:]
        + (3 * s2 - 2 * s3) * end[:3]
        + (s3 - s2) * span_s * end[3:]
    )


def attitude_of(message: Any) -> FloatArray | None:
    """The unit quaternion (4,), NED from body, of an ATTITUDE or ATTITUDE_QUATERNION; None where it tells none."""
    if message.get_type() == "ATTITUDE":
        angles_rad = (message.yaw, message.pitch, message.roll)
        q = quaternion_from_euler(*angles_rad) if all(map(math.isfinite, angles_rad)) else np.full(4, np.nan)
    else:
        q = np.array([message.q1, message.q2, message.q3, message.q4])
    norm = math.hypot(*q)
    return q / norm if math.isfinite(norm) and 0.5 < norm < 1.5 else None
