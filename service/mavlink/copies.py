"""Recognises a frame that was heard before by another path; the autopilot's follower asks. Free of I/O.

A router or a second radio passes frames on byte for byte, some 0.3 to 8 s late: the first to come counts.
"""

from enum import Enum, auto

from service.common.messages import MavFrame

MOST_SENDERS = 16
WINDOW = 4_096  # frames of one sender: 8 s at 500 a second
WINDOW_NS = 16_000_000_000  # what is later than twice that is no copy: after a reboot a message may be as it was before
_TIMED_IDS = frozenset({2, 30, 31, 33, 111})  # with a time of their own: no two of one sender are alike
_MAYBE_TIMED_IDS = frozenset({260, 265, 271, 285})  # a camera's or gimbal's; some leave the time, which is first, 0
_HEADER_BYTES = {1: 6, 2: 10}


class Verdict(Enum):
    """What a frame is beside those before it."""

    NEW = auto()
    ALIKE = auto()  # as one before, byte for byte; it may have been sent anew
    COPY = auto()


class Copies:
    """Remembers a sender's last `WINDOW` frames or 16 s, twice as much at most, in a table of `MOST_SENDERS`."""

    def __init__(self, window: int = WINDOW) -> None:
        self._window = window
        self._senders: dict[tuple[int, int], _Heard] = {}

    def judge(self, frame: MavFrame, now_ns: int) -> Verdict:
        """Whether the very same frame came before; of a sender beyond the table nobody knows.

        A message without a time of its own may be alike each time: it is a copy where its sequence number follows the
        last sure copy more closely than the last frame that was new.
        """
        sender = (frame.system, frame.component)
        heard = self._senders.get(sender)
        if heard is None:
            if len(self._senders) >= MOST_SENDERS:
                return Verdict.NEW
            heard = self._senders[sender] = _Heard(frame.sequence, now_ns)
        heard.age(now_ns, self._window)
        key = hash(frame.raw)
        if key not in heard.newer and key not in heard.older:
            heard.sequence = frame.sequence
            heard.newer.add(key)
            return Verdict.NEW
        if not heard.is_behind(frame):
            return Verdict.ALIKE
        heard.copied_sequence = frame.sequence
        return Verdict.COPY


class _Heard:
    """One sender's frames, in two generations."""

    def __init__(self, sequence: int, now_ns: int) -> None:
        self.newer: set[int] = set()
        self.older: set[int] = set()
        self.sequence = sequence  # of the last that was new
        self.copied_sequence: int | None = None  # of the last copy
        self._since_ns = now_ns

    def age(self, now_ns: int, window: int) -> None:
        """Forget the older generation once the newer is full or old."""
        if len(self.newer) >= window or now_ns - self._since_ns > WINDOW_NS:
            self.newer, self.older, self._since_ns = set(), self.newer, now_ns

    def is_behind(self, frame: MavFrame) -> bool:
        """Whether a frame that is like one before was not sent anew."""
        if _is_timed(frame):
            return True
        if self.copied_sequence is None:
            return False
        return (frame.sequence - self.copied_sequence) % 256 < (frame.sequence - self.sequence) % 256


def _is_timed(frame: MavFrame) -> bool:
    if frame.message_id in _MAYBE_TIMED_IDS:
        start = _HEADER_BYTES[frame.version]
        return any(frame.raw[start : start + 4])
    return frame.message_id in _TIMED_IDS
