"""Decides when to ask the autopilot for which message how often; used by the autopilot. Free of I/O."""

from collections import deque

CHECK_NS = 5_000_000_000
PAUSE_NS = 1_000_000_000
ACK_WAIT_NS = 1_000_000_000
FALLBACK_NS = 10_000_000_000
LEAST_SHARE = 0.7
MOST_SLOWING = 16


class RateKeeper:
    """Asks for each of `wanted_hz` (by message id), one request at a time, again while a measured rate stays low.

    An acknowledgement does not say which message it is for, so the next request waits for it or for a second.
    """

    def __init__(self, wanted_hz: dict[int, float]) -> None:
        self._wanted_hz = dict(wanted_hz)
        self._slowing = dict.fromkeys(wanted_hz, 1)
        self._heard = dict.fromkeys(wanted_hz, 0)
        self.measured_hz = dict.fromkeys(wanted_hz, 0.0)
        self.acknowledged = False
        self._queue: deque[int] = deque(maxlen=len(wanted_hz))
        self._pending: int | None = None
        self._pending_since_ns = 0
        self._low: set[int] = set()
        self._checked_ns = self._called_ns = 0
        self._fallback_ns = 0

    def start(self, now_ns: int) -> None:
        """Ask for everything: a new connection or a reboot."""
        self._slowing = dict.fromkeys(self._wanted_hz, 1)
        self._heard = dict.fromkeys(self._wanted_hz, 0)
        self._queue.clear()
        self._queue.extend(self._wanted_hz)
        self._pending = None
        self._checked_ns = self._called_ns = self._fallback_ns = now_ns
        self._low.clear()

    def heard(self, message_id: int) -> None:
        """A message of the autopilot arrived."""
        if message_id in self._heard:
            self._heard[message_id] += 1

    def acknowledge(self, accepted: bool, denied: bool) -> None:
        """An answer to a request: a rate that was denied is asked for again at half."""
        self.acknowledged = True
        if self._pending is None:
            return
        number, self._pending = self._pending, None
        if denied and not accepted and self._slowing[number] < MOST_SLOWING:
            self._slowing[number] *= 2
            self._queue.appendleft(number)

    def is_low(self, number: int) -> bool:
        """Whether a message came much too seldom when it was last counted: another client asked for less."""
        return number in self._low

    def due(self, now_ns: int) -> tuple[int, int] | None:
        """(message id, interval in microseconds) to ask for now; called while the autopilot is heard."""
        if now_ns - self._called_ns > PAUSE_NS:  # it was away: what came meanwhile says nothing of its rates
            self._checked_ns, self._heard = now_ns, dict.fromkeys(self._wanted_hz, 0)
            self._low.clear()
        self._called_ns = now_ns
        if now_ns - self._checked_ns >= CHECK_NS:
            self._check(now_ns)
        if self._pending is not None and now_ns - self._pending_since_ns < ACK_WAIT_NS:
            return None
        self._pending = None
        if not self._queue:
            return None
        number = self._queue.popleft()
        self._pending, self._pending_since_ns = number, now_ns
        return number, round(1e6 / self._target_hz(number))

    def needs_fallback(self, attitude_ns: int, now_ns: int) -> bool:
        """Whether to try REQUEST_DATA_STREAM: nothing acknowledged and no attitude for 10 s."""
        if self.acknowledged or now_ns - max(attitude_ns, self._fallback_ns) < FALLBACK_NS:
            return False
        self._fallback_ns = now_ns
        return True

    def _target_hz(self, number: int) -> float:
        return self._wanted_hz[number] / self._slowing[number]

    def _check(self, now_ns: int) -> None:
        elapsed_s = (now_ns - self._checked_ns) * 1e-9
        self._checked_ns = now_ns
        for number, count in self._heard.items():
            self.measured_hz[number] = count / elapsed_s
            self._low.discard(number)
            if count < LEAST_SHARE * self._target_hz(number) * elapsed_s - 1:
                self._low.add(number)
                if number not in self._queue:
                    self._queue.append(number)
            self._heard[number] = 0
