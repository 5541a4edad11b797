"""How far a drone's clock is off the ground's, so that what it tells of times can be read here."""

from collections import deque
from datetime import timezone

from service.common.iso_time import moment_from_iso

_MOST_DELAY_S = 120.0  # of a link: a clock that seems to be behind by less may be right, and its messages late
_KEPT = 32  # of a drone's live messages, about ten seconds


def utc_s_from_text(text: str | None) -> float | None:
    """Seconds since 1970 of an ISO 8601 time; None where it is none."""
    try:
        moment = moment_from_iso(text or "")
    except ValueError:
        return None
    return moment.replace(tzinfo=moment.tzinfo or timezone.utc).timestamp()


class DroneClock:
    """The ground's time minus the drone's, by the live message that was quickest on its way.

    That is the clock's error and the link's least delay in one. Up to two minutes behind it may all be delay: then the
    drone's times are taken as they are, and what it saw is not called fresher than it is.

    Only what is never kept for late joiners may be heard here: status and vehicle.
    """

    def __init__(self) -> None:
        self._behind_s: deque[float] = deque(maxlen=_KEPT)
        self._set_s = 0.0  # by how much the ground's clock was set since

    @property
    def behind_s(self) -> float | None:
        """Seconds to add to the drone's times; None before it was heard."""
        return min(self._behind_s) if self._behind_s else None

    @property
    def may_be_delay(self) -> bool:
        """Whether the drone's clock may be right."""
        return self._added_s != self.behind_s

    def hear(self, told_s: float | None, arrived_s: float) -> bool:
        """A live message's own time and its arrival; whether its times read differently by over a second now."""
        if told_s is None:
            return False
        before = self._added_s
        self._behind_s.append(arrived_s - told_s)
        now = self._added_s
        return before is None or now is None or abs(now - before) > 1.0

    def here_s(self, told_s: float | None, arrived_s: float) -> float | None:
        """A time of the drone's on the ground's clock, never after `arrived_s` and rather too early than too late."""
        return None if told_s is None else min(told_s + (self._added_s or 0.0), arrived_s)

    def live_s(self, told_s: float | None, arrived_s: float) -> float | None:
        """The same as if the link took no time: to compare what comes over it with each other."""
        return None if told_s is None else min(told_s + (self.behind_s or 0.0), arrived_s)

    def set_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much."""
        self._set_s += step_s
        self._behind_s = deque((one + step_s for one in self._behind_s), maxlen=_KEPT)

    @property
    def _added_s(self) -> float | None:
        """What is added to the drone's times: the least that its clock may be behind, by ours of now or of before."""
        behind_s = self.behind_s
        if behind_s is None:
            return None
        return min([behind_s, *(one for one in (0.0, self._set_s) if 0.0 < behind_s - one <= _MOST_DELAY_S)])
