"""Notices raw frames that are cut at the wrong places, as the bytes themselves do not say: by the pauses. Free of I/O.

A camera waits between two frames, not in the midst of one. Where the longest wait of a frame lies inside it, it begins
elsewhere: its size is another one than was told, or a part of one was lost.
"""

_SHARE = 0.5  # of a frame's time: the wait between two is the longest by far
_LEAST_S = 0.005  # shorter ones are the scheduler's


class PauseWatch:
    """The longest wait since the frame before, nothing else."""

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._longest_s, self._is_inside = 0.0, False

    def waited(self, duration_s: float, held: int) -> None:
        """Bytes were waited for with so many of the frame there."""
        if duration_s > self._longest_s:
            self._longest_s, self._is_inside = duration_s, held > 0

    def is_split(self, now_s: float) -> bool:
        """Whether the frame that is whole now has its pause inside."""
        span_s = None if self._began_s is None else now_s - self._began_s
        longest_s, is_inside = self._longest_s, self._is_inside
        self._began_s, self._longest_s, self._is_inside = now_s, 0.0, False
        return span_s is not None and is_inside and longest_s >= max(_SHARE * span_s, _LEAST_S)
