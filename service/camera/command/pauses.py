"""Notices raw frames that are cut at the wrong places, as the bytes do not say it: by the pauses. Free of I/O.

A camera waits between two frames. One that is told another size than it has, or of which a part was lost, waits in the
midst of frames and not before them; one that is told so large that it holds several waits at the same places of each.
A program that is held up by others waits anywhere, and before each frame as well. A size that a whole number of told
frames makes up cannot be known so.
"""

_LEAST_S = 0.005  # shorter waits are the scheduler's
_ALONE = 0.25  # of a wait inside: one before the frame that is shorter is none
_MOST_WAITS = 9  # in a frame that is told three times too wide and high; bytes that trickle in have more
_MOST_KEPT = 32
MOST_DOUBT = 8  # frames that are cut wrongly, beyond those that wait before


class PauseWatch:
    """The waits since the frame before, and how many more frames were cut wrongly than rightly: `doubt`."""

    def __init__(self) -> None:
        self.doubt = 0
        self._is_first = True
        self._before_s = 0.0
        self._inside: list[tuple[int, float]] = []  # bytes that were there, seconds
        self._last_places: list[int] = []

    def waited(self, duration_s: float, held: int) -> None:
        """Bytes were waited for with so many of the frame there."""
        if not held:
            self._before_s = max(self._before_s, duration_s)
        elif duration_s >= _LEAST_S and len(self._inside) < _MOST_KEPT:
            self._inside.append((held, duration_s))

    def is_split(self) -> bool:
        """Whether the frame that is whole now is cut at the wrong places."""
        before_s, inside = self._before_s, self._inside
        self._before_s, self._inside = 0.0, []
        if self._is_first:  # the wait before it was for the program to begin
            self._is_first, before_s = False, 0.0
        inside_s = max((wait_s for _, wait_s in inside), default=0.0)
        places = [held for held, wait_s in inside if wait_s >= 0.5 * max(inside_s, before_s)]
        is_same, self._last_places = places == self._last_places, places
        if not places or len(places) > _MOST_WAITS:
            self.doubt = max(self.doubt - int(before_s >= _LEAST_S), 0)
            return False
        is_split = before_s < _ALONE * inside_s or is_same
        self.doubt = self.doubt + 1 if is_split else max(self.doubt - 1, 0)
        return is_split
