"""Notices raw frames that are cut at the wrong places, as the bytes do not say it: by the pauses. Free of I/O.

A camera waits between two frames, not in the midst of one. Frames that are told another size than they have, or of
which a part was lost, pause inside. A size that a whole number of told frames makes up cannot be known so.
"""

_LEAST_S = 0.005  # shorter waits are the scheduler's
_MOST_WAITS = 9  # in a frame that is told three times too wide and high; bytes that trickle in have more
_MOST_KEPT = 32
MOST_DOUBT = 8  # frames that pause inside, beyond those that pause before


class PauseWatch:
    """The waits since the frame before, and how many more frames paused inside than before them: `doubt`."""

    def __init__(self) -> None:
        self.doubt = 0
        self._is_first = True
        self._before_s = 0.0
        self._inside_s: list[float] = []

    def waited(self, duration_s: float, held: int) -> None:
        """Bytes were waited for with so many of the frame there."""
        if not held:
            self._before_s = max(self._before_s, duration_s)
        elif duration_s >= _LEAST_S and len(self._inside_s) < _MOST_KEPT:
            self._inside_s.append(duration_s)

    def is_split(self) -> bool:
        """Whether the frame that is whole now has its pause inside."""
        before_s, inside_s = self._before_s, self._inside_s
        self._before_s, self._inside_s = 0.0, []
        if self._is_first:  # the wait before it was for the program to begin
            self._is_first, before_s = False, 0.0
        longest_s = max([before_s, *inside_s])
        pauses = sum(one_s >= 0.5 * longest_s for one_s in inside_s)
        if longest_s < _LEAST_S or pauses > _MOST_WAITS:
            return False
        self.doubt = self.doubt + 1 if pauses else max(self.doubt - 1, 0)
        return pauses > 0
