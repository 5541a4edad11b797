"""The clock of a log: finds wild stamps and the steps of a clock that was set, and joins what was stamped by it.

Free of I/O; the reader of .tlog files calls it. What orders a log is the order of its records, and the autopilot's time
since boot says how long a step really took; so a log of 1970 is one like another.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from service.mavlink.framer import frame_from_bytes

BACK_US, AHEAD_US = 500_000, 2_500_000  # from one record to the next; a longer step has to be confirmed
JOINS_US = 10_000_000  # as far ahead as the records that confirm a step may be of each other: a slow link
CONFIRM_RECORDS = 5
MOST_HELD = 256  # unconfirmed records of one clock; by then a step without a time since boot is taken as it stands
MOST_CANDIDATES = 8
MOST_SPANS = 1024  # steps in one log; the clock of the last one is kept
EVEN_US = 1_000_000  # a step ahead that lasted so nearly as long as it says was a gap
_RESUMES_US = 10_000  # after the record before, where nothing says how long a step back took
_RECENT = 64  # times since boot of which the least delayed one counts
_BOOT_IDS = frozenset({30, 31, 33})  # ATTITUDE, ATTITUDE_QUATERNION, GLOBAL_POSITION_INT begin with time_boot_ms
_WRAP_MS = 1 << 32

Record = tuple[int, bytes]


@dataclass(slots=True)
class Span:
    """Records in a row on one clock: their raw stamps lie in [`first_us`, `last_us`]; `shift_us` makes them even."""

    first_us: int
    last_us: int
    shift_us: int


@dataclass(slots=True)
class _Candidate:
    """Records in a row that agree with each other and not with the clock."""

    records: list[Record] = field(default_factory=list)
    boots: list[tuple[int, int, int]] = field(default_factory=list)  # system, time since boot in ms, raw stamp


class LogClock:
    """Takes raw stamps in the order of the file and gives even ones, on the clock that the log began with.

    A stamp that no other bears out costs its record: `wild` counts them, `wild_bytes` their frames' bytes. `spans` has
    each stretch on one clock.
    """

    def __init__(self) -> None:
        self.wild = self.wild_bytes = 0
        self.spans: list[Span] = []
        self._candidates: list[_Candidate] = []
        self._boots: dict[int, deque[tuple[int, int]]] = {}  # by system id: time since boot in ms, even stamp

    def take(self, stamp_us: int, raw: bytes) -> Iterable[Record]:
        """The records with even stamps that this one settles: none while it is unconfirmed."""
        if self.spans and -BACK_US <= stamp_us - self.spans[-1].last_us <= AHEAD_US:
            self._drop_candidates()
            return (self._even(stamp_us, raw),)
        ahead_us = JOINS_US if self.spans else AHEAD_US
        near = [one for one in self._candidates if -BACK_US <= stamp_us - one.records[-1][0] <= ahead_us]
        if near:
            return self._joined(min(near, key=lambda one: abs(stamp_us - one.records[-1][0])), stamp_us, raw)
        if len(self._candidates) == MOST_CANDIDATES:
            self._drop(self._candidates.pop(0))
        self._candidates.append(_Candidate())
        return self._joined(self._candidates[-1], stamp_us, raw)

    def end(self) -> Iterable[Record]:
        """What is left at the log's end: of a log too short to have a clock, the most records that agree."""
        if self.spans or not self._candidates:
            self._drop_candidates()
            return ()
        return self._confirmed(max(self._candidates, key=lambda one: len(one.records)))

    def _joined(self, one: _Candidate, stamp_us: int, raw: bytes) -> Iterable[Record]:
        one.records.append((stamp_us, raw))
        boot = _boot(raw)
        if boot is not None and (boot[0] in self._boots or not self.spans):
            one.boots.append((*boot, stamp_us))
        is_dated = len(one.boots) >= CONFIRM_RECORDS or not self._boots
        is_confirmed = len(one.records) >= CONFIRM_RECORDS and (is_dated or not self.spans)
        return self._confirmed(one) if is_confirmed or len(one.records) >= MOST_HELD else ()

    def _confirmed(self, one: _Candidate) -> Iterable[Record]:
        self._candidates.remove(one)
        self._drop_candidates()
        first_us = one.records[0][0]
        shift_us = self._shift_us(one)
        if self.spans and (shift_us == self.spans[-1].shift_us or len(self.spans) == MOST_SPANS):
            self.spans[-1].last_us = max(self.spans[-1].last_us, first_us)
        else:
            self.spans.append(Span(first_us, first_us, shift_us))
        return [self._even(*record) for record in one.records]

    def _shift_us(self, one: _Candidate) -> int:
        if not self.spans:
            return 0
        last, first_us = self.spans[-1], one.records[0][0]
        before_us, after_us = self._least_delay_us(one)
        if before_us is not None and after_us is not None:
            shift_us = before_us - after_us
            is_gap = first_us > last.last_us and abs(shift_us - last.shift_us) < EVEN_US
            return last.shift_us if is_gap else shift_us
        if first_us > last.last_us:
            return last.shift_us
        return last.last_us + last.shift_us + _RESUMES_US - first_us

    def _least_delay_us(self, one: _Candidate) -> tuple[int | None, int | None]:
        """Stamp minus time since boot of the least delayed record before and after a step; None where it rebooted."""
        for system in {system for system, _, _ in one.boots} & self._boots.keys():
            held = self._boots[system]
            reference_ms = held[-1][0]
            after = [(boot_ms, stamp_us) for number, boot_ms, stamp_us in one.boots if number == system]
            if _signed(after[0][0] - reference_ms) >= -BACK_US // 1000:
                return _delay_us(held, reference_ms), _delay_us(after, reference_ms)
        return None, None

    def _even(self, stamp_us: int, raw: bytes) -> Record:
        span = self.spans[-1]
        span.first_us, span.last_us = min(span.first_us, stamp_us), stamp_us
        even_us = stamp_us + span.shift_us
        boot = _boot(raw)
        if boot is not None:
            self._boots.setdefault(boot[0], deque(maxlen=_RECENT)).append((boot[1], even_us))
        return even_us, raw

    def _drop_candidates(self) -> None:
        while self._candidates:
            self._drop(self._candidates.pop())

    def _drop(self, one: _Candidate) -> None:
        self.wild += len(one.records)
        self.wild_bytes += sum(len(raw) for _, raw in one.records)


def even_rows(rows: Iterable[tuple[int, str]], spans: list[Span]) -> list[tuple[int, str]]:
    """Frames (raw stamp in us, name), in the order of their table, on the even clock of a log's spans, by time.

    Where a clock was set back a stamp may lie in two spans; the order of the table then tells which.
    """
    if all(span.shift_us == 0 for span in spans):
        return sorted(rows)
    at, last_us, even = 0, None, []
    for stamp_us, name in rows:
        fitting = [number for number, span in enumerate(spans) if _is_in(span, stamp_us)]
        if not fitting:
            fitting = [min(range(len(spans)), key=lambda number: _apart_us(spans[number], stamp_us))]
        is_back = last_us is not None and stamp_us < last_us - BACK_US
        later = [number for number in fitting if number > at or (number == at and not is_back)]
        number = later[0] if later else fitting[-1]
        at, last_us = max(at, number), stamp_us
        even.append((stamp_us + spans[number].shift_us, name))
    return sorted(even)


def _is_in(span: Span, stamp_us: int) -> bool:
    return span.first_us - BACK_US <= stamp_us <= span.last_us + BACK_US


def _apart_us(span: Span, stamp_us: int) -> int:
    return max(span.first_us - stamp_us, stamp_us - span.last_us)


def _delay_us(boots: Iterable[tuple[int, int]], reference_ms: int) -> int:
    return min(stamp_us - _signed(boot_ms - reference_ms) * 1000 for boot_ms, stamp_us in boots)


def _boot(raw: bytes) -> tuple[int, int] | None:
    """System id and time since boot in ms of a frame of the autopilot that begins with it."""
    frame = frame_from_bytes(raw)
    if frame.message_id not in _BOOT_IDS or frame.component != 1:
        return None
    start, length = (6, raw[1]) if frame.version == 1 else (10, raw[1])
    return frame.system, int.from_bytes(raw[start : start + min(length, 4)], "little")


def _signed(difference_ms: int) -> int:
    return (difference_ms + _WRAP_MS // 2) % _WRAP_MS - _WRAP_MS // 2
