"""What the service says over MAVLink and when, and its answers to commands. No I/O: bytes come out."""

import math
from collections import Counter, OrderedDict
from collections.abc import Collection, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.camera import Camera
from distloc.types import TargetState
from service.common.host import HostState
from service.common.messages import LocatedTarget, VehicleState
from service.localise.scenery import NoScenery, SceneryState
from service.publish import mavlink_messages as outgoing
from service.publish.mavlink_slots import (
    ASK_ADVICE,
    CAMERA,
    COMPUTER,
    ELLIPSE,
    FOV,
    GEO,
    HEARTBEAT,
    IMAGE,
    INFORMATION,
    NAMED,
    ONBOARD,
    PERIODIC,
    REQUESTABLE,
    SECOND_NS,
    SHORTEST_INTERVAL_NS,
    USUAL_NS,
    WITH_UPDATES,
    is_past,
    whole,
)
from service.publish.onboard_computer import onboard_computer_status
from service.publish.pilot.advice_teller import AdviceTeller
from service.publish.pilot.announcer import MAX_TARGETS, Announcer
from service.publish.pilot.compass_teller import CompassTeller
from service.publish.pilot.fault_teller import FaultTeller

_Slot = tuple[int, int]  # component, message id


class MavlinkPublisher:
    """Sends as components 191 and 100 of the autopilot's system; says nothing until `set_system`.

    The best target is the confirmed one, else the coasting one, with the smallest ellipse; tentative ones stay silent.
    FIRE_ELL and the named values go with `update`, at most once a second for each target unless asked otherwise.
    Commands are taken from `command_systems` alone, others are DENIED; `commands` counts those to us, taken and
    refused, `refused_systems` are the senders of the latter (255 there can be).
    """

    def __init__(self, camera: Camera, command_systems: Collection[int] = (255,)) -> None:
        self.commands: Counter[str] = Counter(taken=0, refused=0)
        self.refused_systems: set[int] = set()
        self._untold: list[int] = []
        self._camera = camera
        self._command_systems = frozenset(command_systems)
        self._system = 0
        self._encoders: dict[int, Any] = {}
        self._interval_ns = {slot: USUAL_NS.get(slot, SECOND_NS) for slot in (*PERIODIC, *WITH_UPDATES)}
        self._sent_ns: dict[_Slot, int] = {}
        self._ellipse_sent_ns: OrderedDict[int, int] = OrderedDict()
        self._announcer = Announcer()
        self._adsb_sent_ns: int | None = None
        self._best: LocatedTarget | None = None
        self._vehicle: VehicleState | None = None
        self._is_healthy = False
        self.host: HostState | None = None  # what ONBOARD_COMPUTER_STATUS says
        self._faults, self._compass, self._advice = FaultTeller(), CompassTeller(), AdviceTeller()
        self._boot_offset_ns = 0

    def set_system(self, system: int) -> None:
        """The autopilot's system id, 1 to 255; ValueError else."""
        if not 1 <= system <= 255:
            raise ValueError(f"a system id is 1 to 255, got {system}")
        if system != self._system:
            self._system = system
            self._encoders = {component: mavlink.MAVLink(None, system, component) for component in (COMPUTER, CAMERA)}

    def update(self, targets: Sequence[LocatedTarget], now_ns: int) -> list[bytes]:
        """After a step: what is new of all targets that there are."""
        self._best = _best(targets)
        if not self._system:
            return []
        texts = [*self._announcer.due(targets, now_ns), *self._advice.due(targets, now_ns)]
        frames = [self._text(text) for text in texts]
        for target in targets:
            if _is_shown(target) and self._is_ellipse_due(target.estimate.id, now_ns):
                frames.append(self._pack(COMPUTER, outgoing.ellipse_array(target, self._boot_ms(now_ns))))
        if self._best is not None and self._is_due((COMPUTER, NAMED), now_ns):
            frames += self._made((COMPUTER, NAMED), now_ns)
        return frames

    def needs_vehicle(self, now_ns: int) -> bool:
        """Whether a message that tells of the vehicle is due, so that `due` needs a new one; else the last will do."""
        return bool(self._system) and any(
            self._is_past_interval(slot, now_ns) for slot in ((CAMERA, IMAGE), (CAMERA, FOV))
        )

    def see_vehicle(self, vehicle: VehicleState | None) -> None:
        """What the next messages tell of the vehicle."""
        self._vehicle = vehicle

    def due(
        self,
        now_ns: int,
        boot_ms: int,
        degraded: tuple[str, ...],
        vehicle: VehicleState | None,
        scenery: SceneryState = NoScenery.state,
    ) -> list[bytes]:
        """What is due by now; call it at 10 Hz or more. `boot_ms` is the autopilot's clock."""
        self._boot_offset_ns = boot_ms * 1_000_000 - now_ns
        self._is_healthy = not degraded
        self.see_vehicle(vehicle)
        if not self._system:
            return []
        frames = [frame for slot in PERIODIC if self._is_due(slot, now_ns) for frame in self._made(slot, now_ns)]
        text = self._faults.due(degraded, now_ns)
        if text is not None:
            frames.append(self._text(text, mavlink.MAV_SEVERITY_WARNING if degraded else mavlink.MAV_SEVERITY_NOTICE))
        if (off := self._compass.due(scenery, now_ns)) is not None:
            frames.append(self._text(off))
        return frames

    def adsb(self, targets: Sequence[LocatedTarget], now_ns: int, since_s: float = 0.0) -> list[bytes]:
        """ADSB_VEHICLE of each shown target, told `since_s` ago, at 1 Hz: only for a link to a ground station."""
        if not self._system or not is_past(self._adsb_sent_ns, SECOND_NS, now_ns):
            return []
        self._adsb_sent_ns = now_ns
        messages = [
            outgoing.adsb_vehicle(target, since_s + max(0.0, target.time_utc_s - target.last_seen_utc_s))
            for target in targets
            if _is_shown(target)
        ]
        return [self._pack(COMPUTER, message) for message in messages]

    def handle(self, message: Any, now_ns: int) -> list[bytes]:
        """Answers to a decoded COMMAND_LONG or COMMAND_INT; nothing for any other message or addressee."""
        if message is None or message.get_type() not in ("COMMAND_LONG", "COMMAND_INT") or not self._is_for_us(message):
            return []
        is_taken = message.get_srcSystem() in self._command_systems
        self.commands["taken" if is_taken else "refused"] += 1
        if not is_taken:
            return self._refused(message)
        for component in (message.target_component,) if message.target_component else (COMPUTER, CAMERA):
            answer = self._answered(component, message, now_ns)
            if answer is not None:
                return answer
        if message.target_component == 0:
            return []  # the autopilot's to answer
        return [self._ack(message.target_component, message, mavlink.MAV_RESULT_UNSUPPORTED)]

    def newly_refused(self) -> list[int]:
        """Systems whose commands were refused since the last call, each once."""
        told, self._untold = self._untold, []
        return told

    def _refused(self, command: Any) -> list[bytes]:
        system = command.get_srcSystem()
        if system not in self.refused_systems:
            self.refused_systems.add(system)
            self._untold.append(system)
        if command.target_component == 0:
            return []
        return [self._ack(command.target_component, command, mavlink.MAV_RESULT_DENIED)]

    def _answered(self, component: int, command: Any, now_ns: int) -> list[bytes] | None:
        """What a component says to a command that it takes; None where it does not know it."""
        number, slot = command.command, (component, whole(command.param1))
        if number == mavlink.MAV_CMD_REQUEST_MESSAGE and slot in REQUESTABLE:
            return self._requested(slot, command, now_ns)
        if number == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL and slot in self._interval_ns:
            return [self._ack(component, command, self._set_interval(slot, command.param2))]
        if number == ASK_ADVICE and component == COMPUTER:
            return self._advised(command, now_ns)
        return self._camera_answered(command, now_ns) if component == CAMERA else None

    def _advised(self, command: Any, now_ns: int) -> list[bytes]:
        texts = self._advice.asked(max(whole(command.param1), 0), now_ns)
        result = mavlink.MAV_RESULT_ACCEPTED if texts else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        return [self._ack(COMPUTER, command, result), *(self._text(text) for text in texts)]

    def _camera_answered(self, command: Any, now_ns: int) -> list[bytes] | None:
        number = command.command
        if number == mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION:  # QGroundControl's, before it took to REQUEST_MESSAGE
            if whole(command.param1) == 1:
                return self._requested((CAMERA, INFORMATION), command, now_ns)
            return [self._ack(CAMERA, command, mavlink.MAV_RESULT_ACCEPTED)]
        if number == mavlink.MAV_CMD_CAMERA_TRACK_POINT:
            return [self._ack(CAMERA, command, self._track_point(command.param1, command.param2))]
        if number == mavlink.MAV_CMD_CAMERA_STOP_TRACKING:
            self._interval_ns[CAMERA, IMAGE] = 0  # the box goes; what burns is located all the same
            return [self._ack(CAMERA, command, mavlink.MAV_RESULT_ACCEPTED)]
        return None

    def _track_point(self, x: float, y: float) -> int:
        """Accepted where the point picked is on the target that is tracked anyway: another cannot be chosen."""
        if self._best is None or self._vehicle is None:
            return int(mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
        if not outgoing.is_on_target(x, y, self._best, self._vehicle, self._camera):
            return int(mavlink.MAV_RESULT_DENIED)
        self._interval_ns[CAMERA, IMAGE] = self._interval_ns[CAMERA, IMAGE] or SECOND_NS
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _is_for_us(self, command: Any) -> bool:
        is_our_system = bool(self._system) and command.target_system == self._system
        return is_our_system and command.target_component in (0, COMPUTER, CAMERA)

    def _requested(self, slot: _Slot, command: Any, now_ns: int) -> list[bytes]:
        messages = self._messages(slot, now_ns)
        result = mavlink.MAV_RESULT_ACCEPTED if messages else mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        ack = self._ack(slot[0], command, result)
        return [ack, *(self._pack(slot[0], message) for message in messages)]

    def _set_interval(self, slot: _Slot, interval_us: float) -> int:
        if not math.isfinite(interval_us):
            return int(mavlink.MAV_RESULT_DENIED)
        interval_ns = USUAL_NS.get(slot, SECOND_NS) if interval_us == 0 else round(interval_us * 1000)
        if interval_us < 0:
            if slot[1] == HEARTBEAT:
                return int(mavlink.MAV_RESULT_DENIED)  # silence would lose the route to us
            interval_ns = 0
        elif interval_ns < SHORTEST_INTERVAL_NS:
            return int(mavlink.MAV_RESULT_DENIED)
        self._interval_ns[slot] = interval_ns
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _ack(self, component: int, command: Any, result: int) -> bytes:
        requester = (command.get_srcSystem(), command.get_srcComponent())
        return self._pack(component, mavlink.MAVLink_command_ack_message(command.command, result, 0, 0, *requester))

    def _text(self, text: bytes, severity: int = mavlink.MAV_SEVERITY_NOTICE) -> bytes:
        return self._pack(COMPUTER, mavlink.MAVLink_statustext_message(severity, text))

    def _made(self, slot: _Slot, now_ns: int) -> list[bytes]:
        return [self._pack(slot[0], message) for message in self._messages(slot, now_ns)]

    def _messages(self, slot: _Slot, now_ns: int) -> list[Any]:
        component, message_id = slot
        boot_ms, best = self._boot_ms(now_ns), self._best
        if message_id == HEARTBEAT:
            kind = mavlink.MAV_TYPE_CAMERA if component == CAMERA else mavlink.MAV_TYPE_ONBOARD_CONTROLLER
            return [outgoing.heartbeat(kind, self._is_healthy)]
        if message_id == INFORMATION:
            return [outgoing.camera_information(self._camera, boot_ms)]
        if message_id == ONBOARD:
            return [] if self.host is None else [onboard_computer_status(self.host, now_ns)]
        if message_id == IMAGE:
            return [outgoing.image_status(best, self._vehicle, self._camera)]
        if message_id == FOV:
            return [] if self._vehicle is None else [outgoing.fov_status(self._vehicle, self._camera, boot_ms)]
        return [] if best is None else _of_target(best, message_id, boot_ms)

    def _is_due(self, slot: _Slot, now_ns: int) -> bool:
        if not self._is_past_interval(slot, now_ns):
            return False
        self._sent_ns[slot] = now_ns
        return True

    def _is_past_interval(self, slot: _Slot, now_ns: int) -> bool:
        interval_ns = self._interval_ns[slot]
        return interval_ns > 0 and is_past(self._sent_ns.get(slot), interval_ns, now_ns)

    def _is_ellipse_due(self, target_id: int, now_ns: int) -> bool:
        interval_ns = self._interval_ns[COMPUTER, ELLIPSE]
        if not interval_ns or not is_past(self._ellipse_sent_ns.get(target_id), interval_ns, now_ns):
            return False
        self._ellipse_sent_ns[target_id] = now_ns
        self._ellipse_sent_ns.move_to_end(target_id)
        if len(self._ellipse_sent_ns) > MAX_TARGETS:
            self._ellipse_sent_ns.popitem(last=False)
        return True

    def _boot_ms(self, now_ns: int) -> int:
        return max(0, (now_ns + self._boot_offset_ns) // 1_000_000) & 0xFFFFFFFF

    def _pack(self, component: int, message: Any) -> bytes:
        return outgoing.packed(self._encoders[component], message)


def _of_target(best: LocatedTarget, message_id: int, boot_ms: int) -> list[Any]:
    if message_id == GEO:
        return [outgoing.geo_status(best)]
    return [outgoing.ellipse_array(best, boot_ms)] if message_id == ELLIPSE else outgoing.named_values(best, boot_ms)


def _is_shown(target: LocatedTarget) -> bool:
    return target.estimate.state in (TargetState.CONFIRMED, TargetState.COASTING) and outgoing.is_placed(target)


def _best(targets: Sequence[LocatedTarget]) -> LocatedTarget | None:
    def rank(target: LocatedTarget) -> tuple[bool, float]:
        ellipse = target.estimate.ellipse95
        return target.estimate.state is not TargetState.CONFIRMED, ellipse.semi_major_m * ellipse.semi_minor_m

    return min((target for target in targets if _is_shown(target)), key=rank, default=None)
