"""Which of the drones' pictures are recorded: few enough that the reports keep their place on the disk."""

from collections import OrderedDict

from service.ground.inbox import Heard

STEP_S = 10.0
MOST_DRONES = 128
_SHARE = 0.25  # of what the record may take, in a day
_DAY_S = 86_400.0
_MOST_WAITING = 100  # messages that the disk has not taken yet: then it is slow, and pictures are the first to go


class Pictures:
    """One of each drone every ten seconds, to a quarter of the record a day; what is no picture always."""

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = _SHARE * most_bytes
        self._day, self._bytes = -1.0, 0.0
        self._last_s: OrderedDict[str, float] = OrderedDict()

    def is_due(self, heard: Heard, waiting: int) -> bool:
        """Whether to record it, while so many messages wait for the disk."""
        if not heard.key.endswith("/preview") or not heard.payload:
            return True
        day = heard.arrived_s // _DAY_S
        if day != self._day:
            self._day, self._bytes = day, 0.0
        size = 4.0 / 3.0 * len(heard.payload)  # in base64
        before_s = self._last_s.get(heard.key)
        if before_s is not None and 0.0 <= heard.arrived_s - before_s < STEP_S:
            return False
        if waiting > _MOST_WAITING or self._bytes + size > self._most_bytes:
            return False
        self._bytes += size
        self._last_s[heard.key] = heard.arrived_s
        self._last_s.move_to_end(heard.key)
        if len(self._last_s) > MOST_DRONES:
            self._last_s.popitem(last=False)
        return True
