"""What people say of a fire: seen, its name, not a fire. Grounds tell each other; the later word holds.

A drone's target numbers begin anew with each flight: a mark says when its fire was first seen.
"""

import math
from collections import OrderedDict
from typing import Annotated, Literal

import msgspec

MOST_MARKS, MOST_EACH = 2_000, 4
SAME_S = 2.0  # two readings of when one fire was first seen, by one clock, are no further apart
_AHEAD_S = 86_400.0  # of our clock; more is no time
_STEP_S = 0.001
_HOST, _MOST_HOST = r"^[A-Za-z0-9._-]*$", 40


def name_of(host: str) -> str:
    """A ground's name in its marks: its computer's, of the characters that may be."""
    return "".join(one for one in host if one.isascii() and (one.isalnum() or one in "._-"))[:_MOST_HOST]


class Mark(msgspec.Struct, frozen=True, kw_only=True):
    """As it goes over zenoh, `distloc/VEHICLE/marks/TARGET`; times in seconds since 1970.

    `first_drone_s`: when its fire was first seen, by the drone's own clock; None in marks of before that was told.
    """

    schema: Literal["distloc/mark/1"] = "distloc/mark/1"
    vehicle: str
    target: int
    time_s: float
    is_acknowledged: bool = False
    name: str = ""
    ground: Annotated[str, msgspec.Meta(pattern=_HOST, max_length=_MOST_HOST)] = ""  # its computer, where it was said
    verdict: Literal["", "not_a_fire"] = ""
    first_drone_s: float | None = None

    @property
    def number(self) -> str:
        """`VEHICLE/TARGET`: of one fire of each flight."""
        return f"{self.vehicle}/{self.target}"


class Marks:
    """The latest mark of each of the newest 2,000 fires, of four of one number."""

    def __init__(self) -> None:
        self._marks: OrderedDict[str, tuple[Mark, ...]] = OrderedDict()
        self._count = 0

    def of(self, number: str) -> tuple[Mark, ...]:
        """Those of all fires that were `VEHICLE/TARGET`; the fire that was first seen last is last."""
        return self._marks.get(number, ())

    def all(self) -> list[Mark]:
        """The number of the oldest word first."""
        return [one for own in self._marks.values() for one in own]

    def take(self, mark: Mark, now_s: float) -> bool:
        """Another ground's, or a kept one; whether it is later than ours."""
        known = self.of(mark.number)
        ours = next((one for one in known if _is_of_same(one, mark)), None)
        if not 0.0 <= mark.time_s <= now_s + _AHEAD_S or (ours is not None and order(ours) >= order(mark)):
            return False
        others = sorted((one for one in known if one is not ours), key=order)[1 - MOST_EACH :]
        self._marks[mark.number] = tuple(sorted((*others, mark), key=_first_drone_s))
        self._marks.move_to_end(mark.number)
        self._count += len(self._marks[mark.number]) - len(known)
        while self._count > MOST_MARKS:
            self._count -= len(self._marks.popitem(last=False)[1])
        return True

    def dated(self, mark: Mark, now_s: float) -> Mark:
        """Our own word, later than what we know, though another ground's clock be ahead."""
        known_s = max((one.time_s + _STEP_S for one in self.of(mark.number)), default=0.0)
        return msgspec.structs.replace(mark, time_s=max(now_s, known_s))


def order(mark: Mark) -> tuple[float, bytes]:
    """The later is more; two at one moment: all grounds take the same."""
    return mark.time_s, msgspec.json.encode(mark)


def _is_of_same(one: Mark, other: Mark) -> bool:
    if one.first_drone_s is None or other.first_drone_s is None:
        return one.first_drone_s is other.first_drone_s
    return abs(one.first_drone_s - other.first_drone_s) <= SAME_S


def _first_drone_s(mark: Mark) -> float:
    return -math.inf if mark.first_drone_s is None else mark.first_drone_s
