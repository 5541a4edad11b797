"""What the pilot is told of where to fly next, and when; the MAVLink publisher asks. Free of I/O."""

import math
from collections import OrderedDict
from collections.abc import Sequence

from distloc.advice.advise import Advice
from distloc.types import TargetState
from service.common.messages import LocatedTarget

UNSURE_NS = 60_000_000_000  # so long tentative
AGAIN_NS = 60_000_000_000
FRESH_NS = 30_000_000_000
_MOST = 64


def advice_text(advice: Advice) -> bytes:
    """`Fire 3: fly 040 400m for +-80m`; an arc turns left or right about the fire. At most 50 bytes."""
    heading = f"{round(math.degrees(advice.heading_rad)) % 360:03d}"
    way = f"fly {heading}"
    if advice.kind == "arc":
        way = f"arc {heading} {'right' if advice.turns_right else 'left'}"
    gain = "" if advice.half_length_m is None else f" for +-{min(advice.half_length_m, 99_999.0):.0f}m"
    return f"Fire {advice.target}: {way} {min(advice.length_m, 99_999.0):.0f}m{gain}".encode("ascii")[:50]


class AdviceTeller:
    """Tells of a fire that stayed tentative for a minute, once a minute and one at a time; of any when asked."""

    def __init__(self) -> None:
        self._advice: OrderedDict[int, tuple[int, Advice]] = OrderedDict()
        self._unsure_since_ns: OrderedDict[int, int] = OrderedDict()
        self._told_ns: int | None = None

    def due(self, targets: Sequence[LocatedTarget], now_ns: int) -> list[bytes]:
        """The text to send now, if any; `targets` are those that changed."""
        for target in targets:
            self._note(target, now_ns)
        if self._told_ns is not None and 0 <= now_ns - self._told_ns < AGAIN_NS:
            return []
        for target_id, since_ns in self._unsure_since_ns.items():
            advice = self._fresh(target_id, now_ns)
            if advice is not None and now_ns - since_ns >= UNSURE_NS:
                self._told_ns = now_ns
                self._unsure_since_ns.move_to_end(target_id)  # another one's turn comes next
                return [advice_text(advice)]
        return []

    def asked(self, target_id: int, now_ns: int) -> list[bytes]:
        """Of one target, or of all for 0; the latest first, at most five."""
        wanted = [target_id] if target_id else list(reversed(self._advice))
        found = [self._fresh(one, now_ns) for one in wanted]
        return [advice_text(one) for one in found if one is not None][:5]

    def _fresh(self, target_id: int, now_ns: int) -> Advice | None:
        at_ns, advice = self._advice.get(target_id, (0, None))
        return advice if advice is not None and 0 <= now_ns - at_ns <= FRESH_NS else None

    def _note(self, target: LocatedTarget, now_ns: int) -> None:
        target_id = target.estimate.id
        if target.estimate.state is TargetState.TENTATIVE:
            self._unsure_since_ns.setdefault(target_id, now_ns)
        else:
            self._unsure_since_ns.pop(target_id, None)
        self._advice.pop(target_id, None)
        if target.advice is not None:
            self._advice[target_id] = now_ns, target.advice
        for held in (self._advice, self._unsure_since_ns):
            if len(held) > _MOST:
                held.popitem(last=False)
