"""The doctor listens to the links as the service would: what is heard, how often, the clocks, the first camera pose."""

import asyncio
import contextlib
import time
from collections import Counter
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.commands.check.dem import check_dem_there
from service.commands.check.finding import Finding, fail, ok, warn
from service.commands.check.payload import GIMBAL_MEND, payload_findings
from service.common.degraded import Degraded
from service.common.messages import MavFrame
from service.config.doubts import told_errors
from service.config.endpoint import parse_endpoint
from service.config.sections import Config, ConfigError, LinkConfig
from service.mavlink.carrier import LinkError
from service.mavlink.framer import decode
from service.mavlink.link import Link
from service.mavlink.signing import LinkSigning, signing_of_links

_TICK_S = 0.02
_SETTLE_S = 1.5  # the requests for rates go out one by one
_POSE_AGE_NS = 300_000_000  # as the service's own: it has surely settled
_LEAST_SHARE = 0.7
_CLOCK_OFF_S = 2.0
_OWN_LINES = (Degraded.CLOCK, Degraded.RATES, Degraded.GIMBAL, Degraded.ZOOM)
_POSE_MENDS = {
    RejectReason.NO_FIX: "wait for a GPS fix under open sky",
    RejectReason.EKF_UNHEALTHY: Degraded.EKF.mend,
    RejectReason.POSITION_INVALID: "wait for a GPS fix under open sky",
    RejectReason.TURNING: "keep the vehicle and its gimbal still",
    RejectReason.GIMBAL_UNKNOWN: GIMBAL_MEND,
    RejectReason.ZOOMED: Degraded.ZOOM.mend,
    RejectReason.NO_CLOCK: "the autopilot must send messages with time_boot_ms",
}


@dataclass(slots=True)
class _Heard:
    """One link with what came over it; the autopilot is shared by the links that face it."""

    config: LinkConfig
    link: Link
    signing: LinkSigning
    state: str = "closed"  # at the end of listening
    sources: Counter[tuple[int, int]] = field(default_factory=Counter)  # at most 65,536: system, component
    stations: set[int] = field(default_factory=set)  # systems that say that they are ground control


async def check_links(config: Config, listen_s: float) -> list[Finding]:
    """What can be said after `listen_s` of listening."""
    if not config.mavlink.links:
        mend = "add [[mavlink.links]], e.g. url = 'udpin:127.0.0.1:14550'"
        return [warn("link", "mavlink.links is empty: no autopilot is heard", mend)]
    try:
        doctor = _LinkDoctor(config)
    except ConfigError as error:
        return [fail("link", str(error), "correct that key")]
    findings = await doctor.listen(listen_s)
    if any(finding.level == "fail" for finding in findings):
        return findings
    return findings + [finding for one in doctor.heard for finding in doctor.link(one)] + doctor.autopilot_findings()


class _LinkDoctor:
    """Opens the links, feeds an `Autopilot` as the service does and keeps the times; ConfigError for a wrong key."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._autopilot = Autopilot(
            config.mavlink,
            config.camera.mount,
            pose_errors=told_errors(config),
            camera=config.camera,
        )
        self.heard = [
            _Heard(one, Link(parse_endpoint(one.url), self._on_bytes), signing)
            for one, signing in zip(config.mavlink.links, signing_of_links(config.mavlink, time.time_ns), strict=True)
        ]
        self._by_link = {one.link: one for one in self.heard}
        self._listen_s = 0.0
        self._first_pose_s: float | None = None
        self._reasons: Counter[RejectReason] = Counter()
        self._settled: tuple[float, Counter[str]] | None = None
        self._rates_s = 0.0

    async def listen(self, listen_s: float) -> list[Finding]:
        """Listen; the failures of links that cannot be opened."""
        self._listen_s = listen_s
        try:
            for one in self.heard:
                await one.link.open()
        except LinkError as error:
            for one in self.heard:
                one.link.close()
            mend = "if distloc runs already, systemctl stop distloc first; else correct mavlink.links"
            return [fail("link", str(error), mend)]
        tasks = [asyncio.create_task(one.link.run()) for one in self.heard]
        start_s = time.monotonic()
        while (now_s := time.monotonic()) - start_s < listen_s:
            self._tick(now_s - start_s)
            await asyncio.sleep(_TICK_S)
        for one in self.heard:
            one.state = one.link.state
        self._rates_s = time.monotonic() - self._settled[0] if self._settled else 0.0
        for task in tasks:
            task.cancel()
        for task in tasks:
            with contextlib.suppress(asyncio.CancelledError):
                await task
        return []

    def link(self, one: _Heard) -> list[Finding]:
        """What came over one link, whose commands are refused, and what signing refused of it."""
        findings = [self._heard_on(one), *self._refused_stations(one)]
        if not one.signing.refused:
            return findings
        reasons = ", ".join(f"{count} {reason}" for reason, count in sorted(one.signing.refused.items()))
        mend = "give the sender mavlink.signing_key's key and the right time, or this link signed = false"
        return [*findings, warn("link", f"{one.link.name}: frames refused by signing: {reasons}", mend)]

    def _refused_stations(self, one: _Heard) -> list[Finding]:
        taken = self._config.mavlink.command_systems
        refused = sorted(one.stations - set(taken))
        if not refused:
            return []
        names = ", ".join(str(system) for system in refused[:8])
        said = f"{one.link.name}: commands of ground control {names} are refused"
        mend = f"mavlink.command_systems is {list(taken)}: add {names} if it is yours (MAVSDK's own id is 245)"
        return [warn("commands", said, mend)]

    def _heard_on(self, one: _Heard) -> Finding:
        received, name = one.link.counters()["received_bytes"], one.link.name
        said = ", ".join(f"{system}/{component}" for system, component in sorted(one.sources)[:8])
        if one.config.faces == "ground":
            state = f"hears {said}" if said else f"nothing heard in {self._listen_s:.0f} s"
            return (
                ok("link", f"{name}: {state}") if said else warn("link", f"{name}: {state}", "start the ground's side")
            )
        if not received:
            mend = "check the wiring, the port and that the autopilot (or its router) sends there"
            return fail("link", f"{name}: nothing heard in {self._listen_s:.0f} s ({one.state})", mend)
        if not one.sources and one.signing.refused:
            return fail("link", f"{name}: no frame that signing accepts", "see the warning about it")
        if not one.sources:
            mend = "correct the baud rate, or set that port of the autopilot to MAVLink 2"
            return fail("link", f"{name}: {received} bytes but no MAVLink", mend)
        if not any(component == 1 for _, component in one.sources):
            mend = "let the router pass the autopilot's messages on"
            return fail("link", f"{name}: no autopilot's heartbeat, only {said}", mend)
        return ok("link", f"{name}: hears {said}")

    def autopilot_findings(self) -> list[Finding]:
        """Of the autopilot, once it was heard."""
        facing = [one for one in self.heard if one.config.faces == "autopilot"]
        if not facing:
            return [fail("autopilot", "no link faces one", "give one of mavlink.links faces = 'autopilot'")]
        if self._settled is None:
            wanted = self._config.mavlink.target_system
            mend = f"mavlink.target_system is {wanted}: correct it" if wanted else "listen longer: --seconds"
            return (
                [fail("autopilot", "its heartbeat was not heard", mend)] if any(one.sources for one in facing) else []
            )
        payload = payload_findings(self._autopilot, time.monotonic_ns())
        there = check_dem_there(self._config.ground, self._autopilot)
        return [self._rates(), *self._clocks(), *payload, *self._degraded(), self._pose(), *there]

    def _on_bytes(self, link: Link, data: bytes) -> bool:
        one, now_ns = self._by_link[link], time.monotonic_ns()
        frames = [frame for frame in link.whole_frames(data) if one.signing.accepts(frame)]
        for frame in frames:
            if not frame.is_known:
                continue
            one.sources[frame.system, frame.component] += 1
            if frame.message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT and _is_station(frame):
                one.stations.add(frame.system)
            if one.config.faces == "autopilot":
                self._autopilot.receive(frame, now_ns)
        return any(frame.is_known for frame in frames)

    def _tick(self, since_s: float) -> None:
        now_ns = time.monotonic_ns()
        for data in self._autopilot.due(now_ns):
            for one in self.heard:
                if one.config.faces == "autopilot":
                    one.link.send(one.signing.signed(data))
        if not self._autopilot.is_connected(now_ns):
            return
        if self._settled is None:
            self._settled = time.monotonic() + _SETTLE_S, Counter()
        elif time.monotonic() < self._settled[0]:
            self._settled = self._settled[0], Counter(self._autopilot.messages)
        pose = self._autopilot.camera_pose(now_ns - _POSE_AGE_NS, now_ns)
        if isinstance(pose, RejectReason):
            self._reasons[pose] += 1
        elif isinstance(pose, CameraPose) and self._first_pose_s is None:
            self._first_pose_s = since_s

    def _rates(self) -> Finding:
        if self._settled is None or self._rates_s < 1.0:  # its first heartbeat came late
            return warn("rates", "heard too briefly to count", "listen longer: --seconds")
        counted = self._autopilot.messages - self._settled[1]
        attitude_hz = (counted["ATTITUDE"] + counted["ATTITUDE_QUATERNION"]) / self._rates_s
        position_hz = counted["GLOBAL_POSITION_INT"] / self._rates_s
        wanted = self._config.mavlink
        said = (
            f"attitude {attitude_hz:.0f} a second of {wanted.attitude_hz:g} asked for, "
            f"position {position_hz:.0f} of {wanted.position_hz:g}"
        )
        if not attitude_hz or not position_hz:
            return fail(
                "rates", said, "the autopilot must take SET_MESSAGE_INTERVAL or send both by itself (SRn_EXTRA1)"
            )
        if attitude_hz < _LEAST_SHARE * wanted.attitude_hz or position_hz < _LEAST_SHARE * wanted.position_hz:
            return warn("rates", said, Degraded.RATES.mend)
        return ok("rates", said)

    def _clocks(self) -> list[Finding]:
        now_ns, sync = time.monotonic_ns(), self._autopilot.timesync
        if sync.degraded:
            findings = [warn("clock", "no TIMESYNC replies: poses are timed by arrival", Degraded.CLOCK.mend)]
        else:
            findings = [ok("clock", f"TIMESYNC, round trip {(sync.rtt_ns or 0) * 1e-6:.1f} ms")]
        time_utc_s, source = self._autopilot.utc_s(now_ns)
        off_s = time.time() - time_utc_s
        if source != "gps":
            findings.append(
                warn("utc", "the autopilot has no UTC: the host's clock dates the reports", "wait for GPS time")
            )
        elif abs(off_s) > _CLOCK_OFF_S:
            said = f"the host's clock is {off_s:+.0f} s off the autopilot's"
            findings.append(warn("utc", said, "set it: timedatectl set-ntp true, or chrony with the GPS"))
        else:
            findings.append(ok("utc", f"from GPS; the host's clock is within {_CLOCK_OFF_S:.0f} s"))
        return findings

    def _degraded(self) -> list[Finding]:
        """What the service would call degraded, but for what has lines of its own."""
        names = self._autopilot.degraded(time.monotonic_ns())
        others = [name for name in names if name not in _OWN_LINES]
        return [warn(name, name.meaning, name.mend) for name in others]

    def _pose(self) -> Finding:
        if self._first_pose_s is not None:
            return ok("pose", f"the first camera pose after {self._first_pose_s:.1f} s")
        said = f"no camera pose in {self._listen_s:.0f} s"
        if not self._reasons:
            return fail("pose", said, "listen longer: --seconds")
        reason = self._reasons.most_common(1)[0][0]
        mend = _POSE_MENDS.get(reason, "see the rates above")
        return fail("pose", f"{said}: {reason}", mend)


def _is_station(heartbeat: MavFrame) -> bool:
    message = decode(heartbeat)
    return message is not None and message.type == mavlink.MAV_TYPE_GCS
