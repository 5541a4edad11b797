"""How far a drone's clock is off the ground's, so that what it tells of times can be read here."""

from collections import deque
from datetime import datetime, timezone

_KEPT = 32  # of a drone's live messages, about ten seconds


def utc_s_from_text(text: str | None) -> float | None:
    """Seconds since 1970 of an ISO 8601 time; None where it is none."""
    try:
        moment = datetime.fromisoformat((text or "").replace("Z", "+00:00"))  # Python 3.10 knows no Z
    except ValueError:
        return None
    return moment.replace(tzinfo=moment.tzinfo or timezone.utc).timestamp()


class DroneClock:
    """The ground's time minus the drone's, by the live message that was quickest on its way.

    Only what is never kept for late joiners may be heard here: status and vehicle.
    """

    def __init__(self) -> None:
        self._behind_s: deque[float] = deque(maxlen=_KEPT)

    @property
    def behind_s(self) -> float | None:
        """Seconds to add to the drone's times; None before it was heard."""
        return min(self._behind_s) if self._behind_s else None

    def hear(self, told_s: float | None, arrived_s: float) -> bool:
        """A live message's own time and its arrival; whether `behind_s` moved by over a second."""
        if told_s is None:
            return False
        before = self.behind_s
        self._behind_s.append(arrived_s - told_s)
        now = self.behind_s
        return before is None or now is None or abs(now - before) > 1.0

    def here_s(self, told_s: float | None, arrived_s: float) -> float | None:
        """A time of the drone's on the ground's clock, never after `arrived_s`."""
        if told_s is None:
            return None
        return min(told_s + (self.behind_s or 0.0), arrived_s)
