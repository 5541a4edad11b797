"""Counts the messages that a sender's sequence numbers say were lost; used by the autopilot."""

MOST_SENDERS = 16
MOST_PATHS = 3
_NEAR = 16  # a copy further on than this after every path's last frame came by a path not heard before


class SequenceLosses:
    """Losses per (system, component) in a bounded table; a sender beyond it is not counted.

    A second path brings the same frames later: each path's last number is kept, a frame is of the path whose number
    it follows most closely, and copies show where a path is but count for nothing.
    """

    def __init__(self) -> None:
        self.lost: dict[tuple[int, int], int] = {}
        self._paths: dict[tuple[int, int], list[int]] = {}

    def heard(self, system: int, component: int, sequence: int, *, is_copy: bool = False) -> None:
        """A frame arrived; a step of half the circle or more is disorder or a restart, not a loss."""
        sender = (system, component)
        paths = self._paths.get(sender)
        if paths is None:
            if len(self._paths) < MOST_SENDERS:
                self._paths[sender], self.lost[sender] = [sequence], 0
            return
        missing, path = min(((sequence - last - 1) % 256, path) for path, last in enumerate(paths))
        if is_copy and missing > _NEAR and len(paths) < MOST_PATHS:
            paths.append(sequence)
            return
        if not is_copy and missing < 128:
            self.lost[sender] += missing
        paths[path] = sequence

    def heard_unchecked(self, system: int, component: int, sequence: int) -> None:
        """A frame of an id that we don't know, whose checksum nobody can test: it makes no sender known."""
        if (system, component) in self._paths:
            self.heard(system, component, sequence)
