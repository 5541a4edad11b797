"""What people say of a fire: seen, its name, not a fire. Grounds tell each other; the later word holds."""

from collections import OrderedDict
from typing import Annotated, Literal

import msgspec

MOST_MARKS = 2_000
_AHEAD_S = 86_400.0  # of our clock; more is no time
_STEP_S = 0.001
_HOST, _MOST_HOST = r"^[A-Za-z0-9._-]*$", 40


def name_of(host: str) -> str:
    """A ground's name in its marks: its computer's, of the characters that may be."""
    return "".join(one for one in host if one.isascii() and (one.isalnum() or one in "._-"))[:_MOST_HOST]


class Mark(msgspec.Struct, frozen=True, kw_only=True):
    """As it goes over zenoh, `distloc/VEHICLE/marks/TARGET`; times in seconds since 1970."""

    schema: Literal["distloc/mark/1"] = "distloc/mark/1"
    vehicle: str
    target: int
    time_s: float
    is_acknowledged: bool = False
    name: str = ""
    ground: Annotated[str, msgspec.Meta(pattern=_HOST, max_length=_MOST_HOST)] = ""  # its computer, where it was said
    verdict: Literal["", "not_a_fire"] = ""


class Marks:
    """The latest mark of each of the newest 2,000 fires."""

    def __init__(self) -> None:
        self._marks: OrderedDict[str, Mark] = OrderedDict()

    def get(self, fire_id: str) -> Mark | None:
        """The mark of `VEHICLE/TARGET`."""
        return self._marks.get(fire_id)

    def all(self) -> list[Mark]:
        """Oldest word first."""
        return list(self._marks.values())

    def take(self, mark: Mark, now_s: float) -> bool:
        """Another ground's, or a kept one; whether it is later than ours."""
        fire_id = f"{mark.vehicle}/{mark.target}"
        ours = self._marks.get(fire_id)
        if not 0.0 <= mark.time_s <= now_s + _AHEAD_S or (ours is not None and _order(ours) >= _order(mark)):
            return False
        self._marks[fire_id] = mark
        self._marks.move_to_end(fire_id)
        if len(self._marks) > MOST_MARKS:
            self._marks.popitem(last=False)
        return True

    def dated(self, mark: Mark, now_s: float) -> Mark:
        """Our own word, later than what we know, though another ground's clock be ahead."""
        ours = self._marks.get(f"{mark.vehicle}/{mark.target}")
        return msgspec.structs.replace(mark, time_s=max(now_s, 0.0 if ours is None else ours.time_s + _STEP_S))


def _order(mark: Mark) -> tuple[float, bytes]:
    return mark.time_s, msgspec.json.encode(mark)  # two at one moment: all grounds take the same
