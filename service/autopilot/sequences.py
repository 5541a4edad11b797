"""Counts the messages that a sender's sequence numbers say were lost; used by the autopilot."""

MOST_SENDERS = 16


class SequenceLosses:
    """Losses per (system, component) in a bounded table; a sender beyond it is not counted."""

    def __init__(self) -> None:
        self.lost: dict[tuple[int, int], int] = {}
        self._last: dict[tuple[int, int], int] = {}

    def heard(self, system: int, component: int, sequence: int) -> None:
        """A frame arrived; a step of half the circle or more is disorder or a restart, not a loss."""
        sender = (system, component)
        last = self._last.get(sender)
        if last is None:
            if len(self._last) >= MOST_SENDERS:
                return
            self.lost[sender] = 0
        else:
            missing = (sequence - last - 1) % 256
            if missing < 128:
                self.lost[sender] += missing
        self._last[sender] = sequence
