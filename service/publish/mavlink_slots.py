"""Which MAVLink messages the publisher sends, from which component, and how often."""

import math

from pymavlink.dialects.v20 import ardupilotmega as mavlink

COMPUTER, CAMERA = mavlink.MAV_COMP_ID_ONBOARD_COMPUTER, mavlink.MAV_COMP_ID_CAMERA
SECOND_NS = 1_000_000_000
SHORTEST_INTERVAL_NS = SECOND_NS // 20
LATE_SHARE = 0.05  # a call that comes this share of the period early still sends: no beat is skipped by jitter
ASK_ADVICE = mavlink.MAV_CMD_USER_1  # where to fly next: docs/advice.md

HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
ELLIPSE = mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY
NAMED = mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT
GEO = mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_GEO_STATUS
IMAGE = mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS
FOV = mavlink.MAVLINK_MSG_ID_CAMERA_FOV_STATUS
INFORMATION = mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION
ONBOARD = mavlink.MAVLINK_MSG_ID_ONBOARD_COMPUTER_STATUS
_COMPUTERS = (COMPUTER, HEARTBEAT), (COMPUTER, ONBOARD)
PERIODIC = (*_COMPUTERS, (CAMERA, HEARTBEAT), (CAMERA, GEO), (CAMERA, IMAGE), (CAMERA, FOV))
WITH_UPDATES = ((COMPUTER, ELLIPSE), (COMPUTER, NAMED))
USUAL_NS = {(COMPUTER, ONBOARD): 5 * SECOND_NS}  # of 250 bytes; all else once a second
REQUESTABLE = (*PERIODIC, *WITH_UPDATES, (CAMERA, INFORMATION))


def is_past(last_ns: int | None, interval_ns: int, now_ns: int) -> bool:
    """Whether what was sent last is due again; a clock that went back makes it so."""
    return last_ns is None or not 0 <= now_ns - last_ns < interval_ns * (1.0 - LATE_SHARE)


def whole(value: float) -> int:
    """A command's parameter as a number; -1 for what is none."""
    return int(value) if math.isfinite(value) else -1
