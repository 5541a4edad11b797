"""Follows one autopilot: its clock, poses and health from frames in, requests to it out. No I/O; the service owns it.

Axes and times: poses are kept at the autopilot's time since boot; callers ask by the host's clock.
"""

import math
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geodesy import LocalFrame
from distloc.rotations import (
    R_ENU_FROM_NED,
    R_cam_from_enu,
    euler_from_quaternion,
    matrix_from_quaternion,
    quaternion_from_euler,
)
from distloc.types import CameraPose, FloatArray, PoseErrors, RejectReason
from service.boot_clock import BootClock
from service.config import MavlinkConfig, MountConfig, PoseErrorsConfig
from service.gimbal import Gimbal
from service.health import Health
from service.mavlink_framer import Decoder
from service.messages import MavFrame
from service.pose_jumps import JumpWatch
from service.pose_quality import PoseQuality
from service.poses import WAIT_NS, PoseHistory
from service.rates import RateKeeper
from service.sequences import SequenceLosses
from service.timesync import Timesync

AUTOPILOT_COMPONENT = 1
OWN_COMPONENTS = (191, 100)  # onboard computer, camera
SYNC_PERIOD_NS = 100_000_000
CONNECTED_NS = 3_000_000_000
EARLIEST_UTC_S = 1_262_304_000.0  # 2010-01-01
LATEST_UTC_S = 4_102_444_800.0  # 2100-01-01
MOST_REPLIES = 8
ORIGIN_APART_M = 500.0  # between two positions in a row, even if seconds were lost in between
GIMBAL_HZ = 20.0

HEARTBEAT, SYSTEM_TIME, GPS_RAW_INT, TIMESYNC = 0, 2, 24, 111
ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT, EKF_STATUS_REPORT, ESTIMATOR_STATUS = 30, 31, 33, 193, 230
COMMAND_ACK, HOME_POSITION, MOUNT_ORIENTATION, GIMBAL_DEVICE_ATTITUDE_STATUS = 77, 242, 265, 285

WANTED_IDS = frozenset(
    {HEARTBEAT, SYSTEM_TIME, GPS_RAW_INT, TIMESYNC, ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT}
    | {EKF_STATUS_REPORT, ESTIMATOR_STATUS, COMMAND_ACK, HOME_POSITION}
    | {MOUNT_ORIENTATION, GIMBAL_DEVICE_ATTITUDE_STATUS}
)
TURN_SPAN_NS = 100_000_000
TURN_RATE_RPS = 0.26  # 15 deg/s: 20 ms of time error and of motion blur are then 0.3 deg


class Autopilot:
    """One autopilot as the service sees it; single-threaded.

    `replay` takes our own recorded TIMESYNC requests from the log. `frame_enu` is None until two valid positions in a
    row agree.
    """

    def __init__(
        self,
        config: MavlinkConfig,
        mount: MountConfig,
        *,
        replay: bool = False,
        host_utc_offset_s: float = 0.0,
        poses: PoseHistory | None = None,
        pose_errors: PoseErrors | None = None,
    ) -> None:
        self.target_system = config.target_system
        self.replay = replay
        self.epoch = 0
        self.frame_enu: LocalFrame | None = None
        self.geoid_undulation_m: float | None = None
        self.heading_deg = 0.0
        self.rejects: Counter[RejectReason] = Counter()
        self.messages: Counter[str] = Counter()
        self.ignored: Counter[str] = Counter()
        self.poses = poses or PoseHistory()
        self.timesync = Timesync()
        self.rates = RateKeeper(_wanted_hz(config, mount))
        self._config = config
        self._R_body_from_mount = mount.R_body_from_mount
        self._lever_arm_body_m = mount.lever_arm_body_m
        self._gimbal = Gimbal() if mount.gimbal else None
        self._host_utc_offset_s = host_utc_offset_s
        self._clock = BootClock()
        self._health = Health()
        self._quality = PoseQuality(pose_errors or PoseErrorsConfig().pose_errors())
        self._jumps = JumpWatch()
        self._losses = SequenceLosses()
        self._decoder = Decoder()
        self._encoder = mavlink.MAVLink(None, srcSystem=config.target_system, srcComponent=OWN_COMPONENTS[0])
        self._heartbeat_ns: int | None = None
        self._attitude_ns = 0
        self._sync_due_ns: int | None = None
        self._replies: deque[tuple[int, int]] = deque(maxlen=MOST_REPLIES)
        self._utc_minus_boot_ns: int | None = None
        self._first_place: tuple[float, float, float] | None = None
        self._position_fault: RejectReason | None = None
        self._home_alt_msl_m: float | None = None
        self._implied_home_alt_msl_m: float | None = None
        self._handlers: dict[int, Callable[[Any, int], None]] = {
            HEARTBEAT: self._on_heartbeat,
            SYSTEM_TIME: self._on_system_time,
            GPS_RAW_INT: self._on_gps,
            TIMESYNC: self._on_timesync,
            ATTITUDE: self._on_attitude,
            ATTITUDE_QUATERNION: self._on_attitude_quaternion,
            GLOBAL_POSITION_INT: self._on_position,
            EKF_STATUS_REPORT: self._on_ekf,
            ESTIMATOR_STATUS: self._quality.estimator_status,
            COMMAND_ACK: self._on_ack,
            HOME_POSITION: self._on_home,
            MOUNT_ORIENTATION: self._on_gimbal,
            GIMBAL_DEVICE_ATTITUDE_STATUS: self._on_gimbal,
        }

    def receive(self, frame: MavFrame, now_ns: int) -> None:
        """Take a frame that arrived at `now_ns` on the host's clock."""
        if self._is_ours(frame):
            if self.replay:
                self.replayed_sent(frame, now_ns)
            else:
                self.ignored["echo"] += 1
            return
        self._losses.heard(frame.system, frame.component, frame.sequence)
        handler = self._handlers.get(frame.message_id)
        if handler is None:
            return
        is_target = frame.component == AUTOPILOT_COMPONENT and self.target_system in (0, frame.system)
        if not is_target or (self._heartbeat_ns is None and frame.message_id != HEARTBEAT):
            self.ignored["foreign" if not is_target else "before_heartbeat"] += 1
            return
        message = self._decoder.decode(frame)
        if message is None:
            self.ignored["undecodable"] += 1
            return
        if frame.message_id == HEARTBEAT and message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            return
        self.target_system = frame.system
        self.messages[message.get_type()] += 1
        self.rates.heard(frame.message_id)
        handler(message, now_ns)

    def replayed_sent(self, frame: MavFrame, now_ns: int) -> None:
        """Take a frame that we sent when the log was recorded; it may come before the autopilot is known."""
        if frame.message_id != TIMESYNC or frame.component != OWN_COMPONENTS[0]:
            return
        message = self._decoder.decode(frame)
        if message is not None and message.tc1 == 0:
            self.timesync.request_sent(message.ts1, now_ns)

    def due(self, now_ns: int) -> list[bytes]:
        """MAVLink 2 frames to send to the autopilot now; call it at least at 10 Hz."""
        if self._heartbeat_ns is None:
            return []
        frames = [self._pack(mavlink.MAVLink_timesync_message(now_ns_of, ts1)) for now_ns_of, ts1 in self._replies]
        self._replies.clear()
        if self._sync_due_ns is None or now_ns >= self._sync_due_ns:
            late = self._sync_due_ns is None or now_ns - self._sync_due_ns > SYNC_PERIOD_NS
            self._sync_due_ns = (now_ns if late else self._sync_due_ns or now_ns) + SYNC_PERIOD_NS
            frames.append(self._pack(mavlink.MAVLink_timesync_message(0, self.timesync.request(now_ns))))
        if self.is_connected(now_ns):
            request = self.rates.due(now_ns)
            if request is not None:
                frames.append(self._command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, *request))
            if self.rates.needs_fallback(self._attitude_ns, now_ns):
                frames += self._stream_requests()
        return frames

    def boot_from_host(self, stamp_ns: int) -> int | None:
        """Nanoseconds since the autopilot's boot of a time on the host's clock."""
        offset_ns = self.timesync.offset_ns()
        return None if offset_ns is None else stamp_ns - offset_ns

    def camera_pose(self, stamp_ns: int, now_ns: int) -> CameraPose | RejectReason | None:  # noqa: PLR0911
        """The camera's pose at a time on the host's clock; None: wait, a later sample may still come."""
        boot_ns, now_boot_ns = self.boot_from_host(stamp_ns), self.boot_from_host(now_ns)
        if boot_ns is None or now_boot_ns is None:
            return None if 0 <= now_ns - stamp_ns < WAIT_NS else RejectReason.NO_CLOCK
        found = self.poses.lookup(boot_ns, now_boot_ns)
        if found in (RejectReason.NO_POSE, RejectReason.STALE_POSE) and self._position_fault is not None:
            return self._position_fault
        if not isinstance(found, tuple):
            return found
        if self._jumps.is_position_doubted(now_ns):
            return RejectReason.POSITION_JUMPED
        q_ned_from_body, position_enu_m = found
        R_ned_from_body = matrix_from_quaternion(q_ned_from_body)
        R_ned_from_base: FloatArray | RejectReason | None = R_ned_from_body
        if self._gimbal is not None:
            R_ned_from_base = self._gimbal.R_ned_from_gimbal(boot_ns, now_boot_ns, R_ned_from_body)
        if not isinstance(R_ned_from_base, np.ndarray):
            return R_ned_from_base
        turn_rate_rps = self._turn_rate_rps(boot_ns, now_boot_ns, R_ned_from_body)
        if self._gimbal is None and turn_rate_rps > TURN_RATE_RPS:
            return RejectReason.TURNING
        camera_position_enu_m = position_enu_m + R_ENU_FROM_NED @ R_ned_from_body @ self._lever_arm_body_m
        errors = self._quality.errors(turn_rate_rps, self.timesync.spread_s, now_ns)
        R_cam = R_cam_from_enu(R_ned_from_base, self._R_body_from_mount)
        return CameraPose(stamp_ns * 1e-9, camera_position_enu_m, R_cam, errors)

    def heading_turned_rad(self, stamp_ns: int) -> float:
        """The sum of the heading's jumps up to a time on the host's clock; any thread may ask."""
        return self._jumps.turned_rad(self.boot_from_host(stamp_ns) or 0)

    def _turn_rate_rps(self, boot_ns: int, now_boot_ns: int, R_ned_from_body: FloatArray) -> float:
        """How fast the body turned before this time: a small error of time turns the camera away; 0 where unknown."""
        earlier = self.poses.attitudes.at(boot_ns - TURN_SPAN_NS, now_boot_ns)
        if not isinstance(earlier, np.ndarray):
            return 0.0
        cosine = (np.trace(matrix_from_quaternion(earlier).T @ R_ned_from_body) - 1.0) / 2.0
        return float(np.arccos(np.clip(cosine, -1.0, 1.0))) / (TURN_SPAN_NS * 1e-9)

    def utc_s(self, stamp_ns: int) -> tuple[float, str]:
        """UTC of a time on the host's clock, and its source: "gps" or "host"."""
        boot_ns = self.boot_from_host(stamp_ns)
        if boot_ns is None or self._utc_minus_boot_ns is None:
            return stamp_ns * 1e-9 + self._host_utc_offset_s, "host"
        return (boot_ns + self._utc_minus_boot_ns) * 1e-9, "gps"

    @property
    def home_alt_msl_m(self) -> float | None:
        """HOME_POSITION's altitude, else where the last valid position puts home; None before either."""
        return self._home_alt_msl_m if self._home_alt_msl_m is not None else self._implied_home_alt_msl_m

    def is_connected(self, now_ns: int) -> bool:
        """Whether a heartbeat came within the last 3 s."""
        return self._heartbeat_ns is not None and now_ns - self._heartbeat_ns <= CONNECTED_NS

    def degraded(self, now_ns: int) -> tuple[str, ...]:
        """What is not as it should be: "link", "clock", "ekf", "rates", "position", "heading"."""
        faults = {
            "link": not self.is_connected(now_ns),
            "clock": self.timesync.degraded,
            "ekf": self._health.is_ekf_degraded(),
            "rates": self.rates.is_low(GLOBAL_POSITION_INT) or self.rates.is_low(ATTITUDE),
            "position": self._jumps.is_position_doubted(now_ns),
            "heading": self._jumps.heading_rad(now_ns) > 0.0,
        }
        return tuple(name for name, is_present in faults.items() if is_present)

    def counters(self) -> dict[str, object]:
        """Figures for the status, in a fixed order."""
        return {
            "target_system": self.target_system,
            "epoch": self.epoch,
            "messages": dict(sorted(self.messages.items())),
            "ignored": dict(sorted(self.ignored.items())),
            "rejects": {str(reason): count for reason, count in sorted(self.rejects.items())},
            "rates_hz": {str(number): round(hz, 2) for number, hz in sorted(self.rates.measured_hz.items())},
            "lost": {f"{system}/{part}": count for (system, part), count in sorted(self._losses.lost.items())},
            "clock": self.timesync.source,
            "clock_spread_ns": self.timesync.spread_ns,
            "rtt_ns": self.timesync.rtt_ns,
            "attitudes": self.poses.attitude_count,
            "positions": self.poses.position_count,
            "jumps": dict(self._jumps.counts),
            "ekf_flags": self._health.ekf_flags,
            "fix_type": self._health.fix_type,
        }

    def _is_ours(self, frame: MavFrame) -> bool:
        return frame.component in OWN_COMPONENTS and self.target_system in (0, frame.system)

    def _on_heartbeat(self, message: Any, now_ns: int) -> None:
        if self._heartbeat_ns is None:
            self._encoder.srcSystem = self.target_system
            self._attitude_ns = now_ns
            self.rates.start(now_ns)
        self._heartbeat_ns = now_ns

    def _on_timesync(self, message: Any, now_ns: int) -> None:
        if message.tc1 == 0:
            self._replies.append((now_ns, message.ts1))
            return
        if not self.timesync.reply(message.ts1, message.tc1, now_ns):
            self.ignored["timesync"] += 1
        elif self.timesync.take_jump():
            self._clock.reset()
            self._restart(now_ns)
        elif self._clock.align(message.tc1):
            self._forget_poses()

    def _on_system_time(self, message: Any, now_ns: int) -> None:
        boot_ns = self._clock.peek(message.time_boot_ms)
        if boot_ns is not None and EARLIEST_UTC_S < message.time_unix_usec * 1e-6 < LATEST_UTC_S:
            self._utc_minus_boot_ns = message.time_unix_usec * 1000 - boot_ns

    def _on_gps(self, message: Any, now_ns: int) -> None:
        self._health.gps(message)
        self._quality.gps(message, now_ns)
        if message.alt_ellipsoid != 0 and message.fix_type >= 3:
            self.geoid_undulation_m = (message.alt_ellipsoid - message.alt) * 1e-3

    def _on_ekf(self, message: Any, now_ns: int) -> None:
        self._health.ekf(message, now_ns)
        self._quality.ekf_status(message, now_ns)

    def _on_home(self, message: Any, now_ns: int) -> None:
        self._home_alt_msl_m = message.altitude * 1e-3

    def _on_ack(self, message: Any, now_ns: int) -> None:
        if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            denied = message.result in (mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED)
            self.rates.acknowledge(message.result == mavlink.MAV_RESULT_ACCEPTED, denied)

    def _on_attitude(self, message: Any, now_ns: int) -> None:
        angles_rad = (message.yaw, message.pitch, message.roll)
        if not all(map(math.isfinite, angles_rad)):
            self.rejects[RejectReason.ATTITUDE_INVALID] += 1
            return
        self._add_attitude(quaternion_from_euler(*angles_rad), message, now_ns)

    def _on_attitude_quaternion(self, message: Any, now_ns: int) -> None:
        self._add_attitude(np.array([message.q1, message.q2, message.q3, message.q4]), message, now_ns)

    def _add_attitude(self, q_ned_from_body: FloatArray, message: Any, now_ns: int) -> None:
        norm = float(np.linalg.norm(q_ned_from_body))
        if not math.isfinite(norm) or not 0.5 < norm < 1.5:
            self.rejects[RejectReason.ATTITUDE_INVALID] += 1
            return
        boot_ns = self._boot_ns(message.time_boot_ms, now_ns)
        if boot_ns is None:
            return
        self._attitude_ns = now_ns
        if self.poses.add_attitude(boot_ns, q_ned_from_body / norm):
            self.heading_deg = math.degrees(euler_from_quaternion(q_ned_from_body / norm)[0]) % 360
            body_rate_rps = np.array([message.rollspeed, message.pitchspeed, message.yawspeed])
            R_ned_from_body = matrix_from_quaternion(q_ned_from_body)
            turns_camera = self._gimbal is None or not self._gimbal.is_from_north
            self._jumps.attitude(boot_ns, R_ned_from_body, body_rate_rps, now_ns, turns_camera=turns_camera)
            self._quality.heading_jumped(self._jumps.heading_rad(now_ns), now_ns)

    def _on_position(self, message: Any, now_ns: int) -> None:
        boot_ns = self._boot_ns(message.time_boot_ms, now_ns)
        if boot_ns is None:
            return
        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        self._position_fault = self._health.position_fault(*place, now_ns)
        if self._position_fault is not None:
            self.rejects[self._position_fault] += 1
            return
        if self.frame_enu is None:
            self.frame_enu = self._first_frame(place)
        if self.frame_enu is None:
            return
        self._implied_home_alt_msl_m = (message.alt - message.relative_alt) * 1e-3
        velocity_enu_mps = np.array([message.vy, message.vx, -message.vz]) * 1e-2
        position_enu_m = self.frame_enu.enu_from_geodetic(*place)
        if self.poses.add_position(boot_ns, position_enu_m, velocity_enu_mps):
            self._jumps.position(boot_ns, position_enu_m, velocity_enu_mps, now_ns)

    def _first_frame(self, place: tuple[float, float, float]) -> LocalFrame | None:
        """Axes at a place that the one before it bears out: one false first position would hold for the whole run."""
        last, self._first_place = self._first_place, place
        if last is None:
            return None
        frame_enu = LocalFrame(*last)
        return frame_enu if float(np.linalg.norm(frame_enu.enu_from_geodetic(*place))) <= ORIGIN_APART_M else None

    def _on_gimbal(self, message: Any, now_ns: int) -> None:
        if self._gimbal is None:
            return
        boot_ns = self._boot_ns(message.time_boot_ms, now_ns)
        if boot_ns is None:
            return
        is_device = message.get_type() == "GIMBAL_DEVICE_ATTITUDE_STATUS"
        take = self._gimbal.device_status if is_device else self._gimbal.mount_orientation
        if not take(message, boot_ns):
            self.rejects[RejectReason.ATTITUDE_INVALID] += 1

    def _boot_ns(self, boot_ms: int, now_ns: int) -> int | None:
        boot_ns = self._clock.update(boot_ms, now_ns)
        if self._clock.take_reboot():
            self.timesync.reset()
            self._restart(now_ns)
        if boot_ns is not None:
            self.timesync.observe_boot(boot_ns, now_ns)
        return boot_ns

    def _restart(self, now_ns: int) -> None:
        """The autopilot rebooted: what was known of its time and state is void, the map's origin stays."""
        self.epoch += 1
        self._forget_poses()
        self._health.clear()
        self._quality.clear()
        self._jumps.clear()
        self._utc_minus_boot_ns = None
        self._attitude_ns = now_ns
        self._sync_due_ns = None
        self.rates.start(now_ns)

    def _forget_poses(self) -> None:
        self.poses.clear()
        if self._gimbal is not None:
            self._gimbal.clear()

    def _stream_requests(self) -> list[bytes]:
        rates_hz = {
            mavlink.MAV_DATA_STREAM_EXTRA1: self._config.attitude_hz,
            mavlink.MAV_DATA_STREAM_POSITION: self._config.position_hz,
            mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: 2,
            mavlink.MAV_DATA_STREAM_EXTRA3: 2,
        }
        target = (self.target_system, AUTOPILOT_COMPONENT)
        return [
            self._pack(mavlink.MAVLink_request_data_stream_message(*target, stream, max(1, min(65535, round(hz))), 1))
            for stream, hz in rates_hz.items()
        ]

    def _command(self, command: int, first: float, second: float) -> bytes:
        target = (self.target_system, AUTOPILOT_COMPONENT)
        return self._pack(mavlink.MAVLink_command_long_message(*target, command, 0, first, second, 0, 0, 0, 0, 0))

    def _pack(self, message: Any) -> bytes:
        packed = bytes(message.pack(self._encoder))
        self._encoder.seq = (self._encoder.seq + 1) % 256
        return packed


def _wanted_hz(config: MavlinkConfig, mount: MountConfig) -> dict[int, float]:
    wanted_hz = {
        ATTITUDE: config.attitude_hz,
        GLOBAL_POSITION_INT: config.position_hz,
        GPS_RAW_INT: 2.0,
        EKF_STATUS_REPORT: 2.0,
        SYSTEM_TIME: 1.0,
        HOME_POSITION: 0.5,
        ESTIMATOR_STATUS: 1.0,  # PX4's; ArduPilot refuses it and is soon left alone
    }
    return wanted_hz | {GIMBAL_DEVICE_ATTITUDE_STATUS: GIMBAL_HZ} if mount.gimbal else wanted_hz
