"""What the service asks its autopilot for and answers it: the frames that are due. No I/O; `autopilot` owns it."""

from collections import deque
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.autopilot.rates import RateKeeper
from service.autopilot.timesync import Timesync
from service.config.sections import MavlinkConfig, MountConfig

AUTOPILOT_COMPONENT = 1
COMPUTER_COMPONENT = 191  # the onboard computer: us
SYNC_PERIOD_NS = 100_000_000  # while the clock is in doubt
SLOW_SYNC_PERIOD_NS = 1_000_000_000  # else: ArduPilot forwards our requests to each ground link
MOST_VAIN_NS = 30_000_000_000  # then nobody seems to reply
MOST_REPLIES = 8
GIMBAL_HZ = 20.0
OLD_GIMBAL_HZ = 10.0


class AutopilotRequests:
    """TIMESYNC in both directions, and SET_MESSAGE_INTERVAL or, where nobody acknowledges it, REQUEST_DATA_STREAM."""

    def __init__(self, config: MavlinkConfig, mount: MountConfig, timesync: Timesync) -> None:
        self.rates = RateKeeper(_wanted_hz(config, mount))
        self._config = config
        self._timesync = timesync
        self._system = config.target_system
        self._encoder = mavlink.MAVLink(None, srcSystem=self._system, srcComponent=COMPUTER_COMPONENT)
        self._attitude_ns = 0
        self._sync_due_ns: int | None = None
        self._unsettled_ns: int | None = None
        self._replies: deque[tuple[int, int]] = deque(maxlen=MOST_REPLIES)

    def start(self, system: int, now_ns: int) -> None:
        """The autopilot of that system id was heard for the first time."""
        self._system = self._encoder.srcSystem = system
        self._attitude_ns = now_ns
        self.rates.start(now_ns)

    def restart(self, now_ns: int) -> None:
        """It rebooted and has forgotten what it was asked for."""
        self._sync_due_ns = self._unsettled_ns = None
        self._attitude_ns = now_ns
        self.rates.start(now_ns)

    def attitude_came(self, now_ns: int) -> None:
        """Streams need not be asked for."""
        self._attitude_ns = now_ns

    def acknowledged(self, message: Any) -> None:
        """Take a COMMAND_ACK."""
        if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            denied = message.result in (mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED)
            self.rates.acknowledge(message.result == mavlink.MAV_RESULT_ACCEPTED, denied)

    def sync_asked(self, ts1: int, now_ns: int) -> None:
        """The autopilot asks for our time; of too many such requests the oldest are forgotten."""
        self._replies.append((now_ns, ts1))

    def due(self, now_ns: int, is_connected: bool) -> list[bytes]:
        """MAVLink 2 frames to send now; called once the autopilot was heard, at least at 10 Hz."""
        frames = [self._pack(mavlink.MAVLink_timesync_message(heard_ns, ts1)) for heard_ns, ts1 in self._replies]
        self._replies.clear()
        if self._sync_due_ns is None or now_ns >= self._sync_due_ns:
            period_ns = self._sync_period_ns(now_ns)
            due_ns = self._sync_due_ns
            late = due_ns is None or now_ns - due_ns > period_ns
            self._sync_due_ns = (now_ns if late or due_ns is None else due_ns) + period_ns
            frames.append(self._pack(mavlink.MAVLink_timesync_message(0, self._timesync.request(now_ns))))
        if is_connected:
            request = self.rates.due(now_ns)
            if request is not None:
                frames.append(self._interval_request(*request))
            if self.rates.needs_fallback(self._attitude_ns, now_ns):
                frames += self._stream_requests()
        return frames

    def _sync_period_ns(self, now_ns: int) -> int:
        """Short while the clock is in doubt, but not for ever where nobody replies."""
        if self._timesync.is_settled(now_ns):
            self._unsettled_ns = None
            return SLOW_SYNC_PERIOD_NS
        if self._unsettled_ns is None:
            self._unsettled_ns = now_ns
        return SYNC_PERIOD_NS if now_ns - self._unsettled_ns <= MOST_VAIN_NS else SLOW_SYNC_PERIOD_NS

    def _interval_request(self, message_id: int, interval_us: float) -> bytes:
        target = (self._system, AUTOPILOT_COMPONENT)
        numbers = (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, interval_us, 0, 0, 0, 0, 0)
        return self._pack(mavlink.MAVLink_command_long_message(*target, *numbers))

    def _stream_requests(self) -> list[bytes]:
        rates_hz = {
            mavlink.MAV_DATA_STREAM_EXTRA1: self._config.attitude_hz,
            mavlink.MAV_DATA_STREAM_POSITION: self._config.position_hz,
            mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: 2,
            mavlink.MAV_DATA_STREAM_EXTRA3: 2,
        }
        target = (self._system, AUTOPILOT_COMPONENT)
        return [
            self._pack(mavlink.MAVLink_request_data_stream_message(*target, stream, max(1, min(65535, round(hz))), 1))
            for stream, hz in rates_hz.items()
        ]

    def _pack(self, message: Any) -> bytes:
        packed = bytes(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        return packed


def _wanted_hz(config: MavlinkConfig, mount: MountConfig) -> dict[int, float]:
    wanted_hz = {
        mavlink.MAVLINK_MSG_ID_ATTITUDE: config.attitude_hz,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: config.position_hz,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0,
        mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,  # PX4's; ArduPilot refuses it and is soon left alone
    }
    gimbal_hz = {
        mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: GIMBAL_HZ,
        mavlink.MAVLINK_MSG_ID_MOUNT_STATUS: OLD_GIMBAL_HZ,  # ArduPilot's up to 4.2; later ones refuse it
    }
    return wanted_hz | (gimbal_hz if mount.gimbal else {})
