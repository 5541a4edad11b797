"""What the pilot is told of targets as text, and when; the MAVLink publisher asks. Free of I/O."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

from distloc.types import TargetState
from service.common.messages import LocatedTarget
from service.publish.mavlink_messages import confirmed_text, given_up_text, is_placed

SECOND_NS = 1_000_000_000
MAX_TARGETS = 64
CHANGED_NS = 10 * SECOND_NS  # a target that changed is told of again, at most so often
REPEATED_NS = 120 * SECOND_NS  # and one that did not, for who came late
APART_NS = 2 * SECOND_NS  # between any two that are told again: a pilot hears them spoken
_SHARE = 0.5  # an ellipse half or twice as long is another one
_SHOWN = (TargetState.CONFIRMED, TargetState.COASTING)
_METRES_A_DEGREE = 111_320.0


@dataclass(frozen=True, slots=True)
class _Said:
    at_ns: int
    lat_deg: float
    lon_deg: float
    semi_major_m: float
    semi_minor_m: float
    azimuth_rad: float


class Announcer:
    """Tells of a target once it is confirmed, again where that no longer holds, again every two minutes, and its end.

    What was said no longer holds where the ellipse's length has halved or doubled, or the place has left it.
    """

    def __init__(self) -> None:
        self._said: OrderedDict[int, _Said] = OrderedDict()
        self._again_ns: int | None = None

    def due(self, targets: Sequence[LocatedTarget], now_ns: int) -> list[bytes]:
        """The texts to send now, at most 50 bytes of ASCII each."""
        texts = [text for target in targets if (text := self._news(target, now_ns)) is not None]
        again = self._again(targets, now_ns)
        return texts if again is None else [*texts, again]

    def _news(self, target: LocatedTarget, now_ns: int) -> bytes | None:
        target_id, state = target.estimate.id, target.estimate.state
        if target_id in self._said:
            self._said.move_to_end(target_id)
            if state is not TargetState.DISMISSED:
                return None
            del self._said[target_id]
            return given_up_text(target_id)
        if state is not TargetState.CONFIRMED or not is_placed(target):
            return None
        return self._say(target, now_ns)

    def _again(self, targets: Sequence[LocatedTarget], now_ns: int) -> bytes | None:
        """What is to be said again of one target: first of one that changed, then of the one said longest ago."""
        if self._again_ns is not None and 0 <= now_ns - self._again_ns < APART_NS:
            return None
        known = [
            (self._said[target.estimate.id], target)
            for target in targets
            if target.estimate.id in self._said and target.estimate.state in _SHOWN and is_placed(target)
        ]
        due = [
            (said, target)
            for said, target in known
            if now_ns - said.at_ns >= (CHANGED_NS if _has_changed(said, target) else REPEATED_NS)
        ]
        if not due:
            return None
        _, target = min(due, key=lambda one: (not _has_changed(*one), one[0].at_ns))
        self._again_ns = now_ns
        return self._say(target, now_ns)

    def _say(self, target: LocatedTarget, now_ns: int) -> bytes:
        ellipse, place = target.estimate.ellipse95, target.place
        self._said[target.estimate.id] = _Said(
            now_ns, place.lat_deg, place.lon_deg, ellipse.semi_major_m, ellipse.semi_minor_m, ellipse.azimuth_rad
        )
        if len(self._said) > MAX_TARGETS:
            self._said.popitem(last=False)
        return confirmed_text(target)


def _has_changed(said: _Said, target: LocatedTarget) -> bool:
    semi_major_m = target.estimate.ellipse95.semi_major_m
    if not _SHARE * said.semi_major_m < semi_major_m < said.semi_major_m / _SHARE:
        return True
    north_m = (target.place.lat_deg - said.lat_deg) * _METRES_A_DEGREE
    turn_deg = (target.place.lon_deg - said.lon_deg + 180.0) % 360.0 - 180.0  # the short way, over the date line too
    east_m = turn_deg * _METRES_A_DEGREE * math.cos(math.radians(said.lat_deg))
    sine, cosine = math.sin(said.azimuth_rad), math.cos(said.azimuth_rad)
    along_m, across_m = east_m * sine + north_m * cosine, east_m * cosine - north_m * sine
    return math.hypot(along_m / max(said.semi_major_m, 1.0), across_m / max(said.semi_minor_m, 1.0)) > 1.0
