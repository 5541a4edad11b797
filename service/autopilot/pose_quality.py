"""How wrong the poses may be, from what the autopilot says of its estimate; used by the autopilot. Free of I/O.

The sizes that the config gives are the least; each rule in `PoseQuality.errors` can only widen them.
"""

import math
from enum import Enum, auto
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import PoseErrors

AGE_NS = 10_000_000_000  # as health.EKF_AGE_NS: what is older says nothing
# Innovation test ratios: an innovation over its gate, 1 is rejected. ArduPilot's NavEKF3 getVariances and PX4 both send
# the root of the squared ratio, so they are linear in the innovation.
GOOD_RATIO = 0.5  # "under normal operation below 0.5": MAVLink common.xml, ESTIMATOR_STATUS
MOST_WIDENING = 10.0  # beyond, the flags tell (health.py) and the pose is refused
# The least innovation of position at ratio 1, in metres: a gate of 5 sigma (EK3_POS_I_GATE, EKF2_GPS_P_GATE) times the
# least noise of GNSS (EK3_POSNE_M_NSE, EKF2_GPS_P_NOISE: 0.5 m).
POSITION_GATE_M = 5.0 * 0.5
RTK_FLOAT_M = 0.3  # a few decimetres until the ambiguities are fixed
METRES_PER_HDOP = 1.0  # range error of a receiver of today under open sky, where it gives no accuracy itself
LOST_FIX_M = 10.0  # the estimator coasts at 1-2 m/s of error for the 7 s until its flags say so (FACTS: SITL)
LEAST_DRIFT_M = 0.1
MOST_POSITION_M = 100.0
COMPASS_RAD = math.radians(2.0)  # heading where a dual antenna fell silent: the config's consumer grade
MOST_HEADING_RAD = math.radians(30.0)  # half a camera's view: wider says nothing more
UNKNOWN_U32 = 2**32 - 1
UNKNOWN_U16 = 2**16 - 1
UNKNOWN_HDOP = 9999  # ArduPilot's GPS_UNKNOWN_DOP


class _Quantity(Enum):
    COMPASS_RATIO = auto()
    VELOCITY_RATIO = auto()
    POSITION_RATIO = auto()
    POSITION_M = auto()
    HEADING_RAD = auto()


class PoseQuality:
    """Widens `base` by what the autopilot said in the last 10 s; of several words on one thing the worst counts."""

    def __init__(self, base: PoseErrors) -> None:
        self._base = base
        self.clear()

    def clear(self) -> None:
        """Forget everything: the autopilot restarted."""
        self._heard: dict[tuple[_Quantity, str], tuple[float, int]] = {}

    def ekf_status(self, message: Any, now_ns: int) -> None:
        """Take an EKF_STATUS_REPORT (ArduPilot); its "variances" are innovation test ratios."""
        self._hear(_Quantity.COMPASS_RATIO, "ekf", message.compass_variance, now_ns)
        self._hear(_Quantity.VELOCITY_RATIO, "ekf", message.velocity_variance, now_ns)
        self._hear(_Quantity.POSITION_RATIO, "ekf", message.pos_horiz_variance, now_ns)

    def estimator_status(self, message: Any, now_ns: int) -> None:
        """Take an ESTIMATOR_STATUS (PX4)."""
        self._hear(_Quantity.COMPASS_RATIO, "estimator", message.mag_ratio, now_ns)
        self._hear(_Quantity.VELOCITY_RATIO, "estimator", message.vel_ratio, now_ns)
        self._hear(_Quantity.POSITION_RATIO, "estimator", message.pos_horiz_ratio, now_ns)
        self._hear(_Quantity.POSITION_M, "estimator", message.pos_horiz_accuracy, now_ns)

    def gps(self, message: Any, now_ns: int) -> None:
        """Take a GPS_RAW_INT."""
        self._hear(_Quantity.POSITION_M, "gps", _gps_position_m(message), now_ns)
        self._hear(_Quantity.HEADING_RAD, "gps", _gps_heading_rad(message), now_ns)

    def heading_jumped(self, by_rad: float, now_ns: int) -> None:
        """The heading jumped by as much: either that before or that after it is wrong."""
        self._hear(_Quantity.HEADING_RAD, "jump", by_rad, now_ns)

    def errors(self, turn_rate_rps: float, sync_spread_s: float, now_ns: int) -> PoseErrors:
        """The errors of a pose now: never under the base; an input that is negative or not finite widens nothing."""
        base = self._base
        position_ratio = self._worst(_Quantity.POSITION_RATIO, now_ns)
        velocity_ratio = self._worst(_Quantity.VELOCITY_RATIO, now_ns)
        # Heading: by the compass' ratio; at least what a dual-antenna receiver says of its own.
        heading_rad = max(
            base.heading_bias_rad * _widening(self._worst(_Quantity.COMPASS_RATIO, now_ns)),
            min(self._worst(_Quantity.HEADING_RAD, now_ns), MOST_HEADING_RAD),
        )
        # Tilt: by the worse ratio of GNSS, for its velocity tells gravity from acceleration.
        tilt_rad = base.tilt_bias_rad * _widening(max(velocity_ratio, position_ratio))
        # Each frame's own: the body turned on for as long as the clocks may disagree.
        slip_rad = turn_rate_rps * sync_spread_s if _is_valid(turn_rate_rps) and _is_valid(sync_spread_s) else 0.0
        # Position: by the velocity's ratio; at least what receiver or estimator state, and a poor ratio's innovation.
        stated_m = self._worst(_Quantity.POSITION_M, now_ns)
        innovation_m = POSITION_GATE_M * min(position_ratio, MOST_WIDENING) if position_ratio > GOOD_RATIO else 0.0
        return PoseErrors(
            heading_bias_rad=heading_rad,
            tilt_bias_rad=tilt_rad,
            attitude_white_rad=math.hypot(base.attitude_white_rad, slip_rad),
            position_m=max(
                base.position_m * _widening(velocity_ratio), min(max(stated_m, innovation_m), MOST_POSITION_M)
            ),
            bias_time_constant_s=base.bias_time_constant_s,
            bias_turn_rad=base.bias_turn_rad,
            # what is stated is mostly slow: of a good receiver's it may be less than the base's
            position_bias_m=min(max(stated_m, LEAST_DRIFT_M), MOST_POSITION_M) if stated_m else base.position_bias_m,
        )

    def _hear(self, quantity: _Quantity, source: str, value: float, now_ns: int) -> None:
        if _is_valid(value):
            self._heard[quantity, source] = (float(value), now_ns)

    def _worst(self, quantity: _Quantity, now_ns: int) -> float:
        """0 where nobody said anything of it lately."""
        said = (entry for (about, _), entry in self._heard.items() if about is quantity)
        return max((value for value, stamp_ns in said if now_ns - stamp_ns <= AGE_NS), default=0.0)


def _is_valid(value: float) -> bool:
    return math.isfinite(value) and value >= 0.0


def _widening(ratio: float) -> float:
    """1 while an innovation test ratio is good, then in proportion, at most `MOST_WIDENING`."""
    return min(max(1.0, ratio / GOOD_RATIO), MOST_WIDENING)


def _gps_position_m(message: Any) -> float:
    """The receiver's own accuracy; where it gives none, by the kind of its fix and its HDOP; 0: nothing to say."""
    fix_type = int(message.fix_type)
    if fix_type == mavlink.GPS_FIX_TYPE_NO_GPS:
        return 0.0  # flown by something else
    if fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
        return LOST_FIX_M  # whatever h_acc says: SITL leaves it at its last value
    if 0 < message.h_acc < UNKNOWN_U32:
        return float(message.h_acc) * 1e-3
    if fix_type > mavlink.GPS_FIX_TYPE_RTK_FLOAT:
        return 0.0  # fixed, static or PPP
    if fix_type == mavlink.GPS_FIX_TYPE_RTK_FLOAT:
        return RTK_FLOAT_M
    return METRES_PER_HDOP * (message.eph * 1e-2 if 0 < message.eph < UNKNOWN_HDOP else 1.0)


def _gps_heading_rad(message: Any) -> float:
    """Of a receiver that gives yaw; without yaw `hdg_acc` is that of the course, which says nothing of the heading."""
    if message.yaw == UNKNOWN_U16:
        return COMPASS_RAD  # it should give yaw and cannot now
    if message.yaw == 0 or message.hdg_acc == UNKNOWN_U32:
        return 0.0
    return math.radians(message.hdg_acc * 1e-5)
