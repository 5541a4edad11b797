"""Follows one autopilot: its clock, poses and health from frames in, what is due to it out. No I/O.

Axes and times: poses are kept at the autopilot's time since boot; callers ask by the host's clock.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from distloc.geometry.geodesy import LocalFrame
from distloc.types import CameraPose, FloatArray, PoseErrors, RejectReason
from service.autopilot.boot_clock import BootClock, BootUtc
from service.autopilot.camera_poses import CameraPoses
from service.autopilot.health import Health
from service.autopilot.intake.intake import Intake
from service.autopilot.message_ids import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    COMMAND_ACK,
    EKF_STATUS_REPORT,
    ESTIMATOR_STATUS,
    GIMBAL_IDS,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    HEARTBEAT,
    HOME_POSITION,
    SYSTEM_TIME,
    TIMESYNC,
    ZOOM_IDS,
)
from service.autopilot.payload.zoom import Zoom
from service.autopilot.place import Place
from service.autopilot.poses import WAIT_NS, PoseHistory, attitude_of
from service.autopilot.requests import AUTOPILOT_COMPONENT, AutopilotRequests
from service.autopilot.timesync import Timesync
from service.common.degraded import Degraded
from service.common.messages import MavFrame
from service.config.sections import CameraConfig, MavlinkConfig, MountConfig, PoseErrorsConfig

CONNECTED_NS = 3_000_000_000


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
        self.epoch = 0
        self.place = Place()
        self.rejects: Counter[RejectReason] = Counter()
        self.timesync = Timesync()
        self.camera = CameraPoses(mount, pose_errors or PoseErrorsConfig().pose_errors(), poses)
        self.poses = self.camera.vehicle
        self.zoom = Zoom(camera)
        self._requests = AutopilotRequests(config, mount, self.timesync)
        self._host_utc_offset_s = host_utc_offset_s
        self._clock = BootClock()
        self._utc = BootUtc(self._clock)
        self._health = Health()
        self._handlers: dict[int, Callable[[Any, int], None]] = {
            HEARTBEAT: self._on_heartbeat,
            SYSTEM_TIME: self._utc.system_time,
            GPS_RAW_INT: self._on_gps,
            TIMESYNC: self._on_timesync,
            ATTITUDE: self._on_attitude,
            ATTITUDE_QUATERNION: self._on_attitude,
            GLOBAL_POSITION_INT: self._on_position,
            EKF_STATUS_REPORT: self._on_ekf,
            ESTIMATOR_STATUS: self._on_estimator,
            COMMAND_ACK: lambda message, now_ns: self._requests.acknowledged(message),
            HOME_POSITION: lambda message, now_ns: self.place.home(message),
            **dict.fromkeys(GIMBAL_IDS, self._on_gimbal),
            **dict.fromkeys(ZOOM_IDS, self.zoom.receive),
        }
        on_own = self._on_own_sync if replay else None
        self._intake = Intake(config.target_system, self._handlers, self._on_other_vehicle, on_own)
        self.messages, self.ignored = self._intake.messages, self._intake.ignored

    def receive(self, frame: MavFrame, now_ns: int) -> None:
        """Take a frame that arrived at `now_ns` on the host's clock."""
        message = self._intake.take(frame, now_ns)
        if message is not None:
            self._requests.rates.heard(frame.message_id)
            self._handlers[frame.message_id](message, now_ns)

    def due(self, now_ns: int) -> list[bytes]:
        """MAVLink 2 frames to send to the autopilot now; call it at least at 10 Hz."""
        if self._intake.heartbeat_ns is None:
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

    def craft_attitude(self, stamp_ns: int, now_ns: int) -> FloatArray | None:
        """R_ned_from_body (3, 3) at a time on the host's clock; None: unknown."""
        boot_ns, now_boot_ns = self.boot_from_host(stamp_ns), self.boot_from_host(now_ns)
        return None if boot_ns is None or now_boot_ns is None else self.camera.R_ned_from_body(boot_ns, now_boot_ns)

    def heading_turned_rad(self, stamp_ns: int) -> float:
        """The sum of the heading's jumps up to a time on the host's clock; any thread may ask."""
        return self.camera.jumps.turned_rad(self.boot_from_host(stamp_ns) or 0)

    def utc_s(self, stamp_ns: int) -> tuple[float, str]:
        """UTC of a time on the host's clock, and its source: "gps" or "host"."""
        boot_ns = self.boot_from_host(stamp_ns)
        utc_s = None if boot_ns is None else self._utc.of_boot_s(boot_ns)
        return (stamp_ns * 1e-9 + self._host_utc_offset_s, "host") if utc_s is None else (utc_s, "gps")

    @property
    def target_system(self) -> int:
        """The system that is followed, as configured or first heard; 0: none yet."""
        return self._intake.followed.system

    @property
    def heading_deg(self) -> float:
        """Clockwise from north, of the newest attitude; 0 before the first."""
        return self.camera.heading_deg

    @property
    def velocity_enu_mps(self) -> FloatArray | None:
        """The newest (3,); None before the first."""
        return self.camera.vehicle.positions.velocity_enu_mps

    @property
    def frame_enu(self) -> LocalFrame | None:
        """The map's axes; None until two valid positions in a row agree."""
        return self.place.frame_enu

    def is_connected(self, now_ns: int) -> bool:
        """Whether a heartbeat came within the last 3 s."""
        return self._intake.heartbeat_ns is not None and now_ns - self._intake.heartbeat_ns <= CONNECTED_NS

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
            "lost": {f"{system}/{part}": count for (system, part), count in sorted(self._intake.losses.lost.items())},
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

    def _on_own_sync(self, message: Any, now_ns: int) -> None:
        self.timesync.request_sent(message.ts1, now_ns)

    def _on_other_vehicle(self) -> None:
        """Another autopilot is followed: the one before gave no pose, nothing was located, so the epoch stays."""
        self.place = Place()
        self._clock.reset()
        self.timesync.reset()
        self._forget()

    def _on_heartbeat(self, message: Any, now_ns: int) -> None:
        if self._intake.heartbeat_ns is None:
            self._requests.start(self.target_system, now_ns)
        self._intake.heartbeat_ns = now_ns

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

    def _on_gps(self, message: Any, now_ns: int) -> None:
        self._health.gps(message)
        self.camera.quality.gps(message, now_ns)
        self.place.gps(message)

    def _on_ekf(self, message: Any, now_ns: int) -> None:
        self._health.ekf(message, now_ns)
        self.camera.quality.ekf_status(message, now_ns)

    def _on_estimator(self, message: Any, now_ns: int) -> None:
        self._health.estimator(message, now_ns)
        self.camera.quality.estimator_status(message, now_ns)

    def _on_attitude(self, message: Any, now_ns: int) -> None:
        q_ned_from_body = attitude_of(message)
        if q_ned_from_body is None:
            self.rejects[RejectReason.ATTITUDE_INVALID] += 1
            return
        boot_ns = self._boot_ns(message.time_boot_ms, now_ns)
        if boot_ns is None:
            return
        self._requests.attitude_came(now_ns)
        body_rate_rps = np.array([message.rollspeed, message.pitchspeed, message.yawspeed])
        self.camera.add_attitude(boot_ns, q_ned_from_body, body_rate_rps, now_ns)

    def _on_position(self, message: Any, now_ns: int) -> None:
        boot_ns = self._boot_ns(message.time_boot_ms, now_ns)
        if boot_ns is None:
            return
        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
        self.camera.position_fault = fault = self._health.position_fault(*place, now_ns)
        if fault is not None:
            self.rejects[fault] += 1
            return
        position_enu_m = self.place.position_enu_m(message)
        if position_enu_m is None:
            return
        velocity_enu_mps = np.array([message.vy, message.vx, -message.vz]) * 1e-2
        self.camera.add_position(boot_ns, position_enu_m, velocity_enu_mps, now_ns)

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
        self._utc.clear()
