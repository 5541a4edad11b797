"""Follows one autopilot: its clock, poses and health from frames in, what is due to it out. No I/O.

Axes and times: poses are kept at the autopilot's time since boot; callers ask by the host's clock.
"""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import CameraPose, FloatArray, PoseErrors, RejectReason
from service.autopilot.boot_clock import WRAP_MS, BootClock
from service.autopilot.camera_poses import CameraPoses
from service.autopilot.followed import Followed
from service.autopilot.health import Health
from service.autopilot.payload.zoom import Zoom
from service.autopilot.poses import WAIT_NS, PoseHistory
from service.autopilot.requests import AUTOPILOT_COMPONENT, COMPUTER_COMPONENT, AutopilotRequests
from service.autopilot.sequences import SequenceLosses
from service.autopilot.timesync import Timesync
from service.common.degraded import Degraded
from service.common.messages import MavFrame
from service.config.sections import CameraConfig, MavlinkConfig, MountConfig, PoseErrorsConfig
from service.mavlink.copies import Copies, Verdict
from service.mavlink.framer import Decoder

OWN_COMPONENTS = (COMPUTER_COMPONENT, 100)  # the second is the camera's
CONNECTED_NS = 3_000_000_000
EARLIEST_UTC_S = 1_262_304_000.0  # 2010-01-01
LATEST_UTC_S = 4_102_444_800.0  # 2100-01-01
SAME_BOOT_NS = 2_000_000_000  # by which two words on the UTC of one boot may differ
ORIGIN_APART_M = 500.0  # between two positions in a row, even if seconds were lost in between

HEARTBEAT, SYSTEM_TIME, GPS_RAW_INT, TIMESYNC = 0, 2, 24, 111
ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT, EKF_STATUS_REPORT, ESTIMATOR_STATUS = 30, 31, 33, 193, 230
COMMAND_ACK, HOME_POSITION = 77, 242
MOUNT_STATUS, MOUNT_ORIENTATION, GIMBAL_DEVICE_ATTITUDE_STATUS = 158, 265, 285
CAMERA_SETTINGS, VIDEO_STREAM_INFORMATION, CAMERA_FOV_STATUS = 260, 269, 271
GIMBAL_IDS = frozenset({MOUNT_STATUS, MOUNT_ORIENTATION, GIMBAL_DEVICE_ATTITUDE_STATUS})
ZOOM_IDS = frozenset({CAMERA_SETTINGS, VIDEO_STREAM_INFORMATION, CAMERA_FOV_STATUS})

# Those that a frame may wait for: what its pose is made of, and the clocks' offset.
POSE_IDS = frozenset({TIMESYNC, ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT, *GIMBAL_IDS})
_OF_POSE = frozenset({ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT})


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
        camera: CameraConfig | None = None,
    ) -> None:
        self._followed = Followed(config.target_system)
        self.replay = replay
        self.epoch = 0
        self.frame_enu: LocalFrame | None = None
        self.geoid_undulation_m: float | None = None
        self.home_lat_lon_deg: tuple[float, float] | None = None
        self.rejects: Counter[RejectReason] = Counter()
        self.messages: Counter[str] = Counter()
        self.ignored: Counter[str] = Counter()
        self.timesync = Timesync()
        self.camera = CameraPoses(mount, pose_errors or PoseErrorsConfig().pose_errors(), poses)
        self.poses = self.camera.vehicle
        self.zoom = Zoom(camera)
        self._requests = AutopilotRequests(config, mount, self.timesync)
        self._host_utc_offset_s = host_utc_offset_s
        self._clock = BootClock()
        self._health = Health()
        self._losses = SequenceLosses()
        self._copies = Copies()
        self._decoder = Decoder()
        self._heartbeat_ns: int | None = None
        self._utc_minus_boot_ns: int | None = None
        self._first_place: tuple[float, float, float] | None = None
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
            ESTIMATOR_STATUS: self._on_estimator,
            COMMAND_ACK: lambda message, now_ns: self._requests.acknowledged(message),
            HOME_POSITION: self._on_home,
            **dict.fromkeys(GIMBAL_IDS, self._on_gimbal),
            **dict.fromkeys(ZOOM_IDS, self.zoom.receive),
        }

    def receive(self, frame: MavFrame, now_ns: int) -> None:  # noqa: PLR0911 (a ladder of guards)
        """Take a frame that arrived at `now_ns` on the host's clock."""
        if not frame.is_known:
            self._losses.heard_unchecked(frame.system, frame.component, frame.sequence)
            return
        is_ours, verdict = self._is_ours(frame), self._copies.judge(frame, now_ns)
        if is_ours and not self.replay:
            self.ignored["echo"] += 1
            return
        if not is_ours:
            self._losses.heard(frame.system, frame.component, frame.sequence, is_copy=verdict is not Verdict.NEW)
        if verdict is Verdict.COPY:
            self.ignored["copy"] += 1
            return
        if is_ours:
            self.replayed_sent(frame, now_ns)
            return
        handler = self._handlers.get(frame.message_id)
        if handler is None:
            return
        if frame.component == AUTOPILOT_COMPONENT:
            self._choose(frame, now_ns)
        is_of_vehicle = frame.component == AUTOPILOT_COMPONENT or frame.message_id in GIMBAL_IDS | ZOOM_IDS
        is_target = is_of_vehicle and self.target_system in (0, frame.system)
        if not is_target or (self._heartbeat_ns is None and frame.message_id != HEARTBEAT):
            self.ignored["foreign" if not is_target else "before_heartbeat"] += 1
            return
        message = self._decoder.decode(frame)
        if message is None:
            self.ignored["undecodable"] += 1
            return
        if frame.message_id == HEARTBEAT and message.autopilot == mavlink.MAV_AUTOPILOT_INVALID:
            return
        self.messages[message.get_type()] += 1
        self._requests.rates.heard(frame.message_id)
        handler(message, now_ns)

    def replayed_sent(self, frame: MavFrame, now_ns: int) -> None:
        """Take a frame that we sent when the log was recorded; it may come before the autopilot is known."""
        if frame.message_id != TIMESYNC or frame.component != COMPUTER_COMPONENT:
            return
        message = self._decoder.decode(frame)
        if message is not None and message.tc1 == 0:
            self.timesync.request_sent(message.ts1, now_ns)

    def due(self, now_ns: int) -> list[bytes]:
        """MAVLink 2 frames to send to the autopilot now; call it at least at 10 Hz."""
        if self._heartbeat_ns is None:
            return []
        return self._requests.due(now_ns, self.is_connected(now_ns))

    def boot_from_host(self, stamp_ns: int) -> int | None:
        """Nanoseconds since the autopilot's boot of a time on the host's clock."""
        offset_ns = self.timesync.offset_ns()
        return None if offset_ns is None else stamp_ns - offset_ns

    def camera_pose(self, stamp_ns: int, now_ns: int) -> CameraPose | RejectReason | None:
        """The camera's pose at a time on the host's clock; None: wait, a later sample may still come."""
        if self.zoom.hides(stamp_ns):
            return RejectReason.ZOOMED
        boot_ns, now_boot_ns = self.boot_from_host(stamp_ns), self.boot_from_host(now_ns)
        if boot_ns is None or now_boot_ns is None:
            return None if 0 <= now_ns - stamp_ns < WAIT_NS else RejectReason.NO_CLOCK
        return self.camera.at(boot_ns, now_boot_ns, now_ns, stamp_ns * 1e-9, self.timesync.spread_s)

    def heading_turned_rad(self, stamp_ns: int) -> float:
        """The sum of the heading's jumps up to a time on the host's clock; any thread may ask."""
        return self.camera.jumps.turned_rad(self.boot_from_host(stamp_ns) or 0)

    def utc_s(self, stamp_ns: int) -> tuple[float, str]:
        """UTC of a time on the host's clock, and its source: "gps" or "host"."""
        boot_ns = self.boot_from_host(stamp_ns)
        if boot_ns is None or self._utc_minus_boot_ns is None:
            return stamp_ns * 1e-9 + self._host_utc_offset_s, "host"
        return (boot_ns + self._utc_minus_boot_ns) * 1e-9, "gps"

    @property
    def target_system(self) -> int:
        """The system that is followed, as configured or first heard; 0: none yet."""
        return self._followed.system

    @property
    def heading_deg(self) -> float:
        """Clockwise from north, of the newest attitude; 0 before the first."""
        return self.camera.heading_deg

    @property
    def home_alt_msl_m(self) -> float | None:
        """HOME_POSITION's altitude, else where the last valid position puts home; None before either."""
        return self._home_alt_msl_m if self._home_alt_msl_m is not None else self._implied_home_alt_msl_m

    def is_connected(self, now_ns: int) -> bool:
        """Whether a heartbeat came within the last 3 s."""
        return self._heartbeat_ns is not None and now_ns - self._heartbeat_ns <= CONNECTED_NS

    def degraded(self, now_ns: int) -> tuple[Degraded, ...]:
        """What is not as it should be of link, clock, estimate, rates and poses."""
        rates, jumps = self._requests.rates, self.camera.jumps
        faults = {
            Degraded.LINK: not self.is_connected(now_ns),
            Degraded.CLOCK: self.timesync.degraded,
            Degraded.EKF: self._health.is_ekf_degraded(),
            Degraded.RATES: rates.is_low(GLOBAL_POSITION_INT) or rates.is_low(ATTITUDE),
            Degraded.POSITION: jumps.is_position_doubted(now_ns),
            Degraded.HEADING: jumps.heading_rad(now_ns) > 0.0,
            Degraded.GIMBAL: bool(self.camera.gimbal and self.camera.gimbal.fault(now_ns)),
            Degraded.ZOOM: bool(self.zoom.fault),
        }
        return tuple(name for name, is_present in faults.items() if is_present)

    def payload_faults(self, now_ns: int) -> tuple[str, ...]:
        """What is wrong with the gimbal and the camera's zoom, in words."""
        gimbal = self.camera.gimbal.fault(now_ns) if self.camera.gimbal else ""
        named = (("gimbal", gimbal), ("zoom", self.zoom.fault))
        return tuple(f"{name}: {fault}" for name, fault in named if fault)

    def counters(self) -> dict[str, object]:
        """Figures for the status, in a fixed order."""
        return {
            "target_system": self.target_system,
            "epoch": self.epoch,
            "messages": dict(sorted(self.messages.items())),
            "ignored": dict(sorted(self.ignored.items())),
            "rejects": {str(reason): count for reason, count in sorted(self.rejects.items())},
            "rates_hz": {str(number): round(hz, 2) for number, hz in sorted(self._requests.rates.measured_hz.items())},
            "lost": {f"{system}/{part}": count for (system, part), count in sorted(self._losses.lost.items())},
            "clock": self.timesync.source,
            "clock_spread_ns": self.timesync.spread_ns,
            "rtt_ns": self.timesync.rtt_ns,
            "attitudes": self.poses.attitude_count,
            "positions": self.poses.position_count,
            "jumps": dict(self.camera.jumps.counts),
            "ekf_flags": self._health.ekf_flags,
            "estimator_flags": self._health.estimator_flags,
            "fix_type": self._health.fix_type,
            "gimbal": None if self.camera.gimbal is None else self.camera.gimbal.counters(),
            "zoom": self.zoom.fault,
        }

    def _is_ours(self, frame: MavFrame) -> bool:
        """Sent by us and come back; of a camera's words we send only CAMERA_FOV_STATUS, which `zoom` knows for ours."""
        is_own = frame.component in OWN_COMPONENTS and frame.message_id not in ZOOM_IDS
        return is_own and self.target_system in (0, frame.system)

    def _choose(self, frame: MavFrame, now_ns: int) -> None:
        """Heed what a frame of an autopilot's component says of whom to follow."""
        if frame.message_id in _OF_POSE:
            self._followed.pose(frame.system)
        if frame.message_id != HEARTBEAT:
            return
        message, before = self._decoder.decode(frame), self.target_system
        is_autopilot = message is not None and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        if is_autopilot and self._followed.heartbeat(frame.system, now_ns) and before != 0:
            # the other gave no pose: nothing was located by its clock or its origin, so the epoch stays
            self._heartbeat_ns = self.frame_enu = self._first_place = self.geoid_undulation_m = None
            self._home_alt_msl_m = self._implied_home_alt_msl_m = None
            self._clock.reset()
            self.timesync.reset()
            self._forget()

    def _on_heartbeat(self, message: Any, now_ns: int) -> None:
        if self._heartbeat_ns is None:
            self._requests.start(self.target_system, now_ns)
        self._heartbeat_ns = now_ns

    def _on_timesync(self, message: Any, now_ns: int) -> None:
        if message.tc1 == 0:
            self._requests.sync_asked(message.ts1, now_ns)
            return
        if not self.timesync.reply(message.ts1, message.tc1, now_ns):
            self.ignored["timesync"] += 1
        elif self.timesync.take_jump():
            self._clock.restart(now_ns)
            self._restart(now_ns)
        elif self._clock.align(message.tc1):
            self.camera.forget()

    def _on_system_time(self, message: Any, now_ns: int) -> None:
        if not EARLIEST_UTC_S < message.time_unix_usec * 1e-6 < LATEST_UTC_S:
            return
        boot_ns = self._clock.peek(message.time_boot_ms, now_ns)
        if boot_ns is not None:
            self._utc_minus_boot_ns = message.time_unix_usec * 1000 - boot_ns
        elif self._utc_minus_boot_ns is not None:
            apart_ms = (message.time_unix_usec * 1000 - self._utc_minus_boot_ns) // 1_000_000 - message.time_boot_ms
            if min(apart_ms % WRAP_MS, -apart_ms % WRAP_MS) * 1_000_000 <= SAME_BOOT_NS:
                self._clock.doubt_no_more()  # it was sent late, by the boot that we know

    def _on_gps(self, message: Any, now_ns: int) -> None:
        self._health.gps(message)
        self.camera.quality.gps(message, now_ns)
        if message.alt_ellipsoid != 0 and message.fix_type >= 3:
            self.geoid_undulation_m = (message.alt_ellipsoid - message.alt) * 1e-3

    def _on_ekf(self, message: Any, now_ns: int) -> None:
        self._health.ekf(message, now_ns)
        self.camera.quality.ekf_status(message, now_ns)

    def _on_estimator(self, message: Any, now_ns: int) -> None:
        self._health.estimator(message, now_ns)
        self.camera.quality.estimator_status(message, now_ns)

    def _on_home(self, message: Any, now_ns: int) -> None:
        self._home_alt_msl_m = message.altitude * 1e-3
        self.home_lat_lon_deg = (message.latitude * 1e-7, message.longitude * 1e-7)

    def _on_attitude(self, message: Any, now_ns: int) -> None:
        angles_rad = (message.yaw, message.pitch, message.roll)
        if not all(map(math.isfinite, angles_rad)):
            self.rejects[RejectReason.ATTITUDE_INVALID] += 1
            return
        self._add_attitude(quaternion_from_euler(*angles_rad), message, now_ns)

    def _on_attitude_quaternion(self, message: Any, now_ns: int) -> None:
        self._add_attitude(np.array([message.q1, message.q2, message.q3, message.q4]), message, now_ns)

    def _add_attitude(self, q_ned_from_body: FloatArray, message: Any, now_ns: int) -> None:
        norm = math.hypot(*q_ned_from_body)
        if not math.isfinite(norm) or not 0.5 < norm < 1.5:
            self.rejects[RejectReason.ATTITUDE_INVALID] += 1
            return
        boot_ns = self._boot_ns(message.time_boot_ms, now_ns)
        if boot_ns is None:
            return
        self._requests.attitude_came(now_ns)
        body_rate_rps = np.array([message.rollspeed, message.pitchspeed, message.yawspeed])
        self.camera.add_attitude(boot_ns, q_ned_from_body / norm, body_rate_rps, now_ns)

    def _on_position(self, message: Any, now_ns: int) -> None:
        boot_ns = self._boot_ns(message.time_boot_ms, now_ns)
        if boot_ns is None:
            return
        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        self.camera.position_fault = fault = self._health.position_fault(*place, now_ns)
        if fault is not None:
            self.rejects[fault] += 1
            return
        if self.frame_enu is None:
            self.frame_enu = self._first_frame(place)
        if self.frame_enu is None:
            return
        self._implied_home_alt_msl_m = (message.alt - message.relative_alt) * 1e-3
        velocity_enu_mps = np.array([message.vy, message.vx, -message.vz]) * 1e-2
        position_enu_m = self.frame_enu.enu_from_geodetic(*place)
        self.camera.add_position(boot_ns, position_enu_m, velocity_enu_mps, now_ns)

    def _first_frame(self, place: tuple[float, float, float]) -> LocalFrame | None:
        """Axes at a place that the one before it bears out: one false first position would hold for the whole run."""
        last, self._first_place = self._first_place, place
        if last is None:
            return None
        frame_enu = LocalFrame(*last)
        return frame_enu if float(np.linalg.norm(frame_enu.enu_from_geodetic(*place))) <= ORIGIN_APART_M else None

    def _on_gimbal(self, message: Any, now_ns: int) -> None:
        now_boot_ns = self.boot_from_host(now_ns)
        if now_boot_ns is None:
            return
        stamp_boot_ns = None
        if message.get_srcComponent() == AUTOPILOT_COMPONENT:  # others have clocks of their own
            stamp_boot_ns = self._clock.peek(getattr(message, "time_boot_ms", 0), now_ns)
        if not self.camera.add_gimbal(message, stamp_boot_ns, now_boot_ns, now_ns):
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
        self._forget()
        self._requests.restart(now_ns)

    def _forget(self) -> None:
        self.camera.restart()
        self._health.clear()
        self._utc_minus_boot_ns = None
