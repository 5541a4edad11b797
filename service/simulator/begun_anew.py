"""A simulated drone whose flight begins anew with each service that starts beside it; `distloc autopilot` flies it.

A service that reads its camera's pictures from a folder or a film begins with the first one whenever it starts: the
drone must be where that one was taken then. Free of I/O.
"""

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.mavlink.framer import Framer
from service.simulator.simulated_autopilot import COMPONENT, SYSTEM, SimulatedAutopilot

_HEARTBEAT, _COMPUTER = 0, 191
_SILENT_S = 3.0
_BEACON_S = 0.05  # while no service is heard: it shall find the drone at once
LEAD_S = 0.05  # from the service's first picture to its first heartbeat's arrival: 0 to 0.1 s on one computer


class BegunAnew:
    """`make(booted_before_s)` gives an autopilot at its flight's start; the time is the caller's, from 0 on."""

    def __init__(self, make: Callable[[float], SimulatedAutopilot]) -> None:
        self._make = make
        self._flying = make(10_000.0)  # of a boot long ago: what comes then is a reboot for sure
        self._since_s = 0.0
        self._heard_s: float | None = None
        self._beacon_s = 0.0
        self._framer = Framer()
        self._beacon = bytes(
            mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4, 3).pack(
                mavlink.MAVLink(None, SYSTEM, COMPONENT)
            )
        )

    def receive(self, data: bytes, t_s: float) -> None:
        """Take bytes that were put on a link; a companion's first heartbeat begins the flight."""
        for frame in self._framer.feed(data):
            if (frame.message_id, frame.component) == (_HEARTBEAT, _COMPUTER):
                if self._heard_s is None or t_s - self._heard_s > _SILENT_S:
                    self._flying, self._since_s = self._make(90.0), t_s - LEAD_S
                self._heard_s = t_s
        self._flying.receive(data, t_s - self._since_s)

    def due(self, t_s: float) -> list[tuple[float, bytes]]:
        """Frames packed up to then, each with the time at which it arrives."""
        sent = [(at_s + self._since_s, frame) for at_s, frame in self._flying.due(t_s - self._since_s)]
        if (self._heard_s is None or t_s - self._heard_s > _SILENT_S) and t_s >= self._beacon_s:
            self._beacon_s = t_s + _BEACON_S
            sent.append((t_s, self._beacon))
        return sent
