"""What an autopilot also sends though the service has no use for it: it is heard and thrown away all the same."""

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

MESSAGES_HZ = 200.0  # of a telemetry link with everything on, all messages together
# What the service asks for on its own (service/autopilot/autopilot.py) and what comes by itself.
_HEARTBEAT_HZ, _TIMESYNC_HZ, _OTHERS_HZ = 1.0, 10.1, 5.5  # GPS, EKF, time and home make up the last
_FASTEST_HZ = 300.0  # ArduCopter's loop is at 400 Hz and refuses what is faster than 0.8 of it
_CHATTER_HZ = {
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 25.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 10.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 10.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: 5.0,
    mavlink.MAVLINK_MSG_ID_VIBRATION: 2.0,
    mavlink.MAVLINK_MSG_ID_MEMINFO: 1.0,
}


def attitude_hz(speed: float) -> float:
    """What the service is to ask for."""
    return min(50.0 * speed, _FASTEST_HZ)


def position_hz(speed: float) -> float:
    """What the service is to ask for."""
    return min(25.0 * speed, _FASTEST_HZ)


def chatter_hz(speed: float) -> dict[int, float]:
    """Rates by message id; with what the service asks for, all are MESSAGES_HZ * speed. RAW_IMU makes up the rest."""
    rates_hz = {number: rate_hz * speed for number, rate_hz in _CHATTER_HZ.items()}
    asked_hz = attitude_hz(speed) + position_hz(speed) + _HEARTBEAT_HZ + _TIMESYNC_HZ + _OTHERS_HZ
    rest_hz = MESSAGES_HZ * speed - asked_hz - sum(rates_hz.values())
    return rates_hz | {mavlink.MAVLINK_MSG_ID_RAW_IMU: rest_hz}


def chatter(message_id: int, boot_ns: int) -> mavlink.MAVLink_message:
    """One message with numbers that change as a sensor's do."""
    return _MAKE[message_id](boot_ns)


def _raw_imu(boot_ns: int) -> mavlink.MAVLink_message:
    noise = boot_ns // 1_000_000 % 97
    return mavlink.MAVLink_raw_imu_message(boot_ns // 1000, noise, -noise, -980 - noise, noise, 3, 5, 210, -80, 400)


def _servo_output_raw(boot_ns: int) -> mavlink.MAVLink_message:
    pulse_us = 1500 + boot_ns // 1_000_000 % 97
    return mavlink.MAVLink_servo_output_raw_message(
        boot_ns // 1000 % 2**32, 0, pulse_us, pulse_us, pulse_us, pulse_us, 0, 0, 0, 0
    )


def _vfr_hud(boot_ns: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_vfr_hud_message(28.0, 28.0, boot_ns // 1_000_000_000 % 360, 45, 550.0, 0.1)


def _rc_channels(boot_ns: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_rc_channels_message(boot_ns // 1_000_000 % 2**32, 8, *([1500] * 18), 200)


def _sys_status(boot_ns: int) -> mavlink.MAVLink_message:
    voltage_mv = 24_000 - boot_ns // 1_000_000_000 % 4000
    return mavlink.MAVLink_sys_status_message(0x3FFF, 0x3FFF, 0x3FFF, 300, voltage_mv, 2500, 70, 0, 0, 0, 0, 0, 0)


def _nav_controller_output(boot_ns: int) -> mavlink.MAVLink_message:
    heading_deg = boot_ns // 1_000_000_000 % 360
    return mavlink.MAVLink_nav_controller_output_message(5.0, 1.0, heading_deg, heading_deg, 100, 0.5, 0.1, 2.0)


def _vibration(boot_ns: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_vibration_message(boot_ns // 1000, 12.0, 11.0, 14.0, 0, 0, 0)


def _meminfo(_boot_ns: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_meminfo_message(0, 40_000)


_MAKE: dict[int, Callable[[int], mavlink.MAVLink_message]] = {
    mavlink.MAVLINK_MSG_ID_RAW_IMU: _raw_imu,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: _servo_output_raw,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: _nav_controller_output,
    mavlink.MAVLINK_MSG_ID_VIBRATION: _vibration,
    mavlink.MAVLINK_MSG_ID_MEMINFO: _meminfo,
}
