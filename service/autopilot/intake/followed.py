"""Decides which system is our autopilot where the config names none; used by the autopilot. Free of I/O."""

import logging
from dataclasses import dataclass

log = logging.getLogger(__name__)

ALIVE_NS = 3_000_000_000
PATIENCE_NS = 12_000_000_000  # asked for its rates at once, and after 10 s in the way of old ArduPilots
MOST_SYSTEMS = 8


@dataclass(slots=True)
class _System:
    heartbeat_ns: int
    gives_pose: bool = False


class Followed:
    """The first autopilot heard; for good once it gave a pose, until then only while it is the best there is.

    It is let go of where another is heard and it fell silent, or gave no pose for 12 s. `system` is 0 before the first.
    """

    def __init__(self, configured: int, is_live: bool = True) -> None:
        self.system = configured
        self._log_level = logging.INFO if is_live else logging.DEBUG  # of a flight that is over nobody needs to know
        self._is_free = configured == 0
        self._since_ns = 0
        self._others: dict[int, _System] = {}
        self._heartbeat_ns = 0

    def heartbeat(self, system: int, now_ns: int) -> bool:
        """An autopilot's heartbeat; True if from now on another system is followed than before."""
        if system == self.system:
            self._heartbeat_ns = now_ns
            return False
        if not self._is_free:
            return False
        if self.system == 0:
            self._follow(system, now_ns)
            log.log(self._log_level, "following system %d, the first autopilot heard", system)
            return True
        other = self._other(system, now_ns)
        if not self._is_let_go(other, now_ns):
            return False
        log.warning(
            "following system %d: system %d, heard first, gives no pose; mavlink.target_system can name ours",
            system,
            self.system,
        )
        self._others[self.system] = _System(self._heartbeat_ns)
        self._others.pop(system, None)
        self._follow(system, now_ns)
        return True

    def pose(self, system: int) -> None:
        """An attitude or a position came from this system."""
        if system == self.system:
            self._is_free = False
        elif system in self._others:
            self._others[system].gives_pose = True

    def _is_let_go(self, other: _System, now_ns: int) -> bool:
        if now_ns - self._heartbeat_ns > ALIVE_NS:
            return True
        # of two that give none each gets its turn: some send nothing but heartbeats until they are asked
        rivals = [one for one in self._others.values() if one.gives_pose and now_ns - one.heartbeat_ns <= ALIVE_NS]
        return now_ns - self._since_ns > PATIENCE_NS and (other.gives_pose or not rivals)

    def _other(self, system: int, now_ns: int) -> _System:
        other = self._others.setdefault(system, _System(now_ns))
        other.heartbeat_ns = now_ns
        if len(self._others) > MOST_SYSTEMS:
            del self._others[min(self._others, key=lambda one: self._others[one].heartbeat_ns)]
        return other

    def _follow(self, system: int, now_ns: int) -> None:
        self.system, self._since_ns, self._heartbeat_ns = system, now_ns, now_ns
