"""The last annotated picture of each drone, and of each fire while it was seen; bounded in number and bytes."""

from collections import OrderedDict
from collections.abc import Iterable
from typing import NamedTuple

MOST_PREVIEW_BYTES = 1_000_000  # of one; a camera's 1280 x 720 has 100 to 300 kB
MOST_PREVIEWS = 512
MOST_BYTES = 64_000_000


class _Preview(NamedTuple):
    jpeg: bytes
    taken_s: float


class Previews:
    """By the name of a drone or the id of a fire; the one that was renewed longest ago gives way."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        self._most_bytes = most_bytes
        self._kept: OrderedDict[str, _Preview] = OrderedDict()
        self._bytes = 0  # a picture of several counts for each

    def take(self, names: Iterable[str], jpeg: bytes, taken_s: float) -> None:
        """A new picture of these."""
        for name in names:
            self.forget(name)
            self._kept[name] = _Preview(jpeg, taken_s)
            self._bytes += len(jpeg)
        while self._bytes > self._most_bytes or len(self._kept) > MOST_PREVIEWS:
            self.forget(next(iter(self._kept)))

    def forget(self, name: str) -> None:
        """Its picture, if there is one."""
        found = self._kept.pop(name, None)
        if found is not None:
            self._bytes -= len(found.jpeg)

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much."""
        for name, one in self._kept.items():
            self._kept[name] = one._replace(taken_s=one.taken_s + step_s)

    def jpeg(self, name: str) -> bytes | None:
        """The picture's bytes."""
        found = self._kept.get(name)
        return None if found is None else found.jpeg

    def taken_s(self, name: str) -> float | None:
        """When it arrived."""
        found = self._kept.get(name)
        return None if found is None else found.taken_s
