"""A simulated autopilot on a real UDP socket; the soak and the fault tests spoil its clock, estimate, link and life."""

import heapq
import itertools
import select
import socket
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import msgspec
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.simulation.paths import VehicleTruth
from service.simulator.chatter import chatter
from service.simulator.scenario import PathSection, Scenario
from service.simulator.simulated_autopilot import SimulatedAutopilot, Stream

_LOOP_S = 0.0025
_ELSEWHERE = PathSection(east_m=-3000.0, north_m=4000.0, height_m=300.0, course_deg=200.0)
Mangle = Callable[[bytes], bytes | None]


class Craft(SimulatedAutopilot):
    """The simulated autopilot with a clock and an estimate that can jump, and messages that the service has no use for.

    `chatter_hz` are those by their ids: `service.simulator.chatter` makes them.
    """

    boot_shift_ns = 0
    jump_enu_m = (0.0, 0.0, 0.0)
    heading_jump_rad = 0.0

    def __init__(
        self, scenario: Scenario, rng: np.random.Generator, chatter_hz: Mapping[int, float] | None = None
    ) -> None:
        super().__init__(scenario, rng)
        for number, rate_hz in (chatter_hz or {}).items():
            self._pack[number] = lambda t_s, number=number: chatter(number, self.boot_ns(t_s))  # type: ignore[misc]
            self._streams[number] = Stream(1.0 / rate_hz, 0.0)

    def boot_ns(self, t_s: float) -> int:
        return super().boot_ns(t_s) + self.boot_shift_ns

    def set_boot(self, t_s: float, boot_ns: int) -> None:
        """Have the clock stand at `boot_ns` at `t_s`."""
        self.boot_shift_ns = boot_ns - super().boot_ns(t_s)

    def _estimate(self, t_s: float) -> VehicleTruth:
        now = super()._estimate(t_s)
        position_enu_m = now.position_enu_m + np.array(self.jump_enu_m)
        return replace(now, position_enu_m=position_enu_m, yaw_rad=now.yaw_rad + self.heading_jump_rad)


class CraftOnAir:
    """Runs crafts in real time on one socket, in a thread of its own.

    `mangle` may change each datagram or take it away; `is_silent` takes them all.
    """

    def __init__(
        self,
        scenario: Scenario,
        port: int,
        start_ns: int,
        boot_ns: int | None = None,
        chatter_hz: Mapping[int, float] | None = None,
        seed: int = 1,
    ) -> None:
        self.is_silent = False
        self.mangle: Mangle = lambda frame: frame
        self.sent = 0
        self._scenario, self._start_ns, self._chatter_hz, self._seed = scenario, start_ns, chatter_hz, seed
        self.craft = Craft(scenario, np.random.default_rng(seed), chatter_hz)
        if boot_ns is not None:
            self.craft.set_boot(0.0, boot_ns)
        self._crafts = [self.craft]
        self._lock = threading.Lock()
        self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._link.connect(("127.0.0.1", port))
        self._link.setblocking(False)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._fly, name="craft", daemon=True)
        self._thread.start()

    @property
    def t_s(self) -> float:
        """Seconds of the scenario."""
        return (time.monotonic_ns() - self._start_ns) * 1e-9

    def reboot(self) -> None:
        """Start anew: a young clock, other errors, no stream but the heartbeat."""
        with self._lock:
            t_s = self.t_s
            self._seed += 1
            self.craft = Craft(self._scenario, np.random.default_rng(self._seed), self._chatter_hz)
            self.craft.set_boot(t_s, 2_000_000_000)
            _start_streams(self.craft, t_s)
            self._crafts[0] = self.craft

    def add_other(self, system: int) -> None:
        """A second autopilot talks on the same link, with its own clock and place, all streams on."""
        with self._lock:
            t_s = self.t_s
            other = Craft(msgspec.structs.replace(self._scenario, path=_ELSEWHERE), np.random.default_rng(3))
            other.set_boot(t_s, 7_000_000_000_000)
            _start_streams(other, t_s)
            other._mav.srcSystem = system
            for number in (mavlink.MAVLINK_MSG_ID_ATTITUDE, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT):
                other._set_interval(number, 0.05, t_s)
            self._crafts.append(other)

    def remove_other(self) -> None:
        """It is gone again."""
        with self._lock:
            del self._crafts[1:]

    def set_system(self, system: int) -> None:
        """Say that it is another."""
        with self._lock:
            self.craft._mav.srcSystem = system

    def set_rate(self, message_id: int, rate_hz: float) -> None:
        """Another client asks for another rate."""
        with self._lock:
            self.craft._set_interval(message_id, 1.0 / rate_hz, self.t_s)

    def inject(self, frame: bytes) -> None:
        """Put a datagram of somebody else on the link."""
        self._link.send(frame)

    def close(self) -> None:
        """Leave the link."""
        self._ended.set()
        self._thread.join(5.0)
        self._link.close()

    def _fly(self) -> None:
        pending: list[tuple[float, int, bytes]] = []
        order = itertools.count()
        while not self._ended.is_set():
            t_s = self.t_s
            with self._lock:
                for craft in self._crafts:
                    for deliver_s, frame in craft.due(t_s):
                        heapq.heappush(pending, (deliver_s, next(order), frame))
            while pending and pending[0][0] <= t_s:
                self._send(heapq.heappop(pending)[2])
            readable, _, _ = select.select([self._link], [], [], _LOOP_S)
            if readable:
                self._receive()

    def _send(self, frame: bytes) -> None:
        data = None if self.is_silent else self.mangle(frame)
        if data is None:
            return
        self.sent += 1
        try:
            self._link.send(data)
        except (ConnectionRefusedError, BlockingIOError):
            return

    def _receive(self) -> None:
        try:
            data = self._link.recv(65535)
        except (ConnectionRefusedError, BlockingIOError):
            return
        if self.is_silent:
            return
        with self._lock:
            for craft in self._crafts:
                craft.receive(data, self.t_s)


def _start_streams(craft: Craft, t_s: float) -> None:
    for stream in craft._streams.values():
        stream.next_s = t_s


def junk(share: float) -> Mangle:
    """Random bytes in the place of a share of the datagrams."""
    rng = np.random.default_rng(4)

    def mangle(frame: bytes) -> bytes:
        return bytes(rng.bytes(int(rng.integers(8, 280)))) if rng.random() < share else frame

    return mangle


def forged_frames(boot_ms: int) -> list[bytes]:
    """A heartbeat and an attitude of system 1, signed with a wrong key, the signature's time in the far future."""
    forger = mavlink.MAVLink(None, 1, 1)
    forger.signing.secret_key = b"\x5a" * 32
    forger.signing.sign_outgoing = True
    forger.signing.timestamp = 2**48 - 1000
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
    attitude = mavlink.MAVLink_attitude_message((boot_ms + 2_000_000_000) % 2**32, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    return [bytes(message.pack(forger)) for message in (heartbeat, attitude)]
