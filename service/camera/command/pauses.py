"""Notices raw frames that are cut at the wrong places, as the bytes do not say it: by the pauses. Free of I/O.

A camera waits between two frames. One that is told another size than it has, or of which a part was lost, waits in the
midst of frames and not before them; one that is told so large that it holds several waits at the same places of each.
All of these wait each so many bytes, to the byte. A program that is held up by others waits anywhere, and so does one
that writes without a pause: its frames are believed. A size that a whole number of told frames makes up cannot be known
so, nor a program that waits in the midst of right frames only, or at equal parts of them.
"""

_LEAST_S = 0.005  # shorter waits are the scheduler's
_ALONE = 0.25  # of a wait inside: one before the frame that is shorter is none
_MOST_WAITS = 9  # in a frame that is told three times too wide and high; bytes that trickle in have more
_MOST_KEPT = 32
MOST_DOUBT = 8  # frames that are cut wrongly, beyond those that wait before


class PauseWatch:
    """The waits since the frame before, and how many more frames were cut wrongly than rightly: `doubt`."""

    def __init__(self, frame_bytes: int) -> None:
        self.doubt = 0
        self._frame_bytes = frame_bytes
        self._start = 0  # of the frame, in bytes since the program's first
        self._is_first = True
        self._before_s = 0.0
        self._inside: list[tuple[int, float]] = []  # bytes that were there, seconds
        self._last: int | None = None  # where it waited last
        self._gap: int | None = None  # bytes from the wait before that one
        self._last_places: list[int] = []

    def waited(self, duration_s: float, held: int, was_full: bool = False) -> None:
        """Bytes were waited for with so many of the frame there; one who had filled the pipe had waited for us."""
        if not held:
            self._before_s = max(self._before_s, duration_s)
        elif duration_s >= _LEAST_S and not was_full and len(self._inside) < _MOST_KEPT:
            self._inside.append((held, duration_s))

    def is_split(self) -> bool:
        """Whether the frame that is whole now is cut at the wrong places."""
        before_s, inside = self._before_s, self._inside
        self._before_s, self._inside = 0.0, []
        if self._is_first:  # the wait before it was for the program to begin
            self._is_first, before_s = False, 0.0
        inside_s = max((wait_s for _, wait_s in inside), default=0.0)
        least_s = 0.5 * max(inside_s, before_s)
        places = [held for held, wait_s in inside if wait_s >= least_s]
        is_same, self._last_places = places == self._last_places, places
        is_even = self._is_even([0, *places] if before_s >= max(least_s, _LEAST_S) else places)
        self._start += self._frame_bytes
        if not places or len(places) > _MOST_WAITS:
            self.doubt = max(self.doubt - int(before_s >= _LEAST_S), 0)
            return False
        is_split = is_even and (before_s < _ALONE * inside_s or is_same)
        self.doubt = self.doubt + 1 if is_split else max(self.doubt - 1, 0)
        return is_split

    def _is_even(self, places: list[int]) -> bool:
        """Whether all waits up to these of the frame are as far apart as the last two were, if there were two."""
        is_even = True
        for place in (self._start + held for held in places):
            gap = None if self._last is None else place - self._last
            is_even = is_even and (self._gap is None or gap == self._gap)
            self._last, self._gap = place, gap
        return is_even
