"""Turns the 32-bit `time_boot_ms` into a time that never wraps and notices a reboot; used by the autopilot."""

from typing import Any

WRAP_MS = 1 << 32
BACK_MS = 1_000
LATE_MS = 15_000  # by how much a second path may be behind: a radio's full queue, a router's retries
AHEAD_MS = 60_000  # how much faster than the host's clock it may run: a full link that empties
EVEN_MS = 1_000  # by which one step may be longer than the host's clock says
CONFIRM_SAMPLES = 3
EARLIEST_UTC_S = 1_262_304_000.0  # 2010-01-01
LATEST_UTC_S = 4_102_444_800.0  # 2100-01-01
SAME_BOOT_NS = 2_000_000_000  # by which two words on the UTC of one boot may differ


class BootClock:
    """Unwraps times since boot; a step that neither age nor wrap explains counts as a reboot once confirmed.

    What a second path brings late is no reboot: neither that of this boot nor, for a while, that of the one before.
    """

    def __init__(self) -> None:
        self._reference_ms: int | None = None
        self._rebooted = False
        self.reset()

    def reset(self) -> None:
        """Forget the time: the autopilot restarted."""
        self._last_ms: int | None = None
        self._last_now_ns = 0
        self._before: tuple[int, int] | None = None  # the last time of the boot before, and the arrival that ended it
        self._odd = _Run()  # times that would be of another boot
        self._ahead = _Run()  # times that are far ahead
        self._reference_ms = None

    def restart(self, now_ns: int) -> None:
        """Forget the time but for what is late of it: somebody else noticed that the autopilot restarted."""
        before = self._last_ms
        self.reset()
        self._before = None if before is None else (before, now_ns)

    def update(self, boot_ms: int, now_ns: int) -> int | None:  # noqa: PLR0911 (a ladder of guards)
        """Nanoseconds since boot of a message that arrived now; None while a reboot is suspected."""
        if self._last_ms is None:
            if self._is_of_before(boot_ms, now_ns):
                return None
            self._last_ms, self._last_now_ns = self._nearest_ms(boot_ms), now_ns
            return self._last_ms * 1_000_000
        step_ms = _signed(boot_ms - self._last_ms)
        elapsed_ms = (now_ns - self._last_now_ns) // 1_000_000
        is_on_time = -BACK_MS <= step_ms <= elapsed_ms + EVEN_MS
        if not is_on_time and self._is_of_before(boot_ms, now_ns):
            return None
        if -LATE_MS <= step_ms <= elapsed_ms * 2 + AHEAD_MS:
            if step_ms > elapsed_ms + EVEN_MS and self._ahead.count(boot_ms, now_ns) < CONFIRM_SAMPLES:
                return None  # a single one that is far ahead changes nothing
            value_ms = self._last_ms + step_ms
            if step_ms > 0:
                self._last_ms, self._last_now_ns = value_ms, now_ns
                self.doubt_no_more()
            return value_ms * 1_000_000
        if self._odd.count(boot_ms, now_ns) < CONFIRM_SAMPLES:
            return None
        self.restart(now_ns)
        self._last_ms, self._last_now_ns, self._rebooted = boot_ms, now_ns, True
        return boot_ms * 1_000_000

    def doubt_no_more(self) -> None:
        """Something else says that there was no reboot: what seemed to tell of one is forgotten."""
        self._odd.clear()

    def peek(self, boot_ms: int, now_ns: int) -> int | None:
        """Nanoseconds since boot of a time that is on time or late; None if it is neither, or nothing is known."""
        if self._last_ms is None:
            return None
        step_ms = _signed(boot_ms - self._last_ms)
        elapsed_ms = (now_ns - self._last_now_ns) // 1_000_000
        is_near = -LATE_MS <= step_ms <= elapsed_ms + AHEAD_MS
        if not is_near or (step_ms > elapsed_ms + EVEN_MS and self._is_of_before(boot_ms, now_ns)):
            return None
        return (self._last_ms + step_ms) * 1_000_000

    def align(self, remote_ns: int) -> bool:
        """Take the wraps from TIMESYNC's 64-bit time; True if times given out before were whole wraps off."""
        self._reference_ms = remote_ns // 1_000_000
        if self._last_ms is None:
            return False
        nearest_ms = self._nearest_ms(self._last_ms)
        if nearest_ms == self._last_ms:
            return False
        self._last_ms = nearest_ms
        return True

    def take_reboot(self) -> bool:
        """Whether a reboot was confirmed since the last call."""
        rebooted, self._rebooted = self._rebooted, False
        return rebooted

    def _is_of_before(self, boot_ms: int, now_ns: int) -> bool:
        """Whether it is what a slower path still brings of the boot before."""
        if self._before is None:
            return False
        last_ms, ended_ns = self._before
        return now_ns - ended_ns <= LATE_MS * 1_000_000 and abs(_signed(boot_ms - last_ms)) <= LATE_MS

    def _nearest_ms(self, boot_ms: int) -> int:
        if self._reference_ms is None:
            return boot_ms
        nearest_ms = self._reference_ms + _signed(boot_ms - self._reference_ms)
        return nearest_ms if nearest_ms >= 0 else boot_ms


class _Run:
    """Times in a row that agree with each other and with the host's clock."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew."""
        self._last: tuple[int, int] | None = None
        self._count = 0

    def count(self, boot_ms: int, now_ns: int) -> int:
        """How many agree, this one included."""
        if self._last is not None:
            elapsed_ms = (now_ns - self._last[1]) // 1_000_000
            agrees = -BACK_MS <= _signed(boot_ms - self._last[0]) <= elapsed_ms + EVEN_MS
            self._count = self._count if agrees else 0
        self._last = (boot_ms, now_ns)
        self._count += 1
        return self._count


class BootUtc:
    """UTC of times since boot, by SYSTEM_TIME."""

    def __init__(self, clock: BootClock) -> None:
        self._clock = clock
        self._utc_minus_boot_ns: int | None = None

    def clear(self) -> None:
        """Forget it: another boot, or another autopilot."""
        self._utc_minus_boot_ns = None

    def system_time(self, message: Any, now_ns: int) -> None:
        """Take a SYSTEM_TIME that arrived at `now_ns`; one of the boot that is known says that there was no reboot."""
        if not EARLIEST_UTC_S < message.time_unix_usec * 1e-6 < LATEST_UTC_S:
            return
        boot_ns = self._clock.peek(message.time_boot_ms, now_ns)
        if boot_ns is not None:
            self._utc_minus_boot_ns = message.time_unix_usec * 1000 - boot_ns
        elif self._utc_minus_boot_ns is not None:
            apart_ms = (message.time_unix_usec * 1000 - self._utc_minus_boot_ns) // 1_000_000 - message.time_boot_ms
            if min(apart_ms % WRAP_MS, -apart_ms % WRAP_MS) * 1_000_000 <= SAME_BOOT_NS:
                self._clock.doubt_no_more()  # it was sent late, by the boot that we know

    def of_boot_s(self, boot_ns: int) -> float | None:
        """Seconds since 1970; None before SYSTEM_TIME told it."""
        return None if self._utc_minus_boot_ns is None else (boot_ns + self._utc_minus_boot_ns) * 1e-9


def _signed(difference_ms: int) -> int:
    """A difference of 32-bit counters in [-2^31, 2^31)."""
    return (difference_ms + WRAP_MS // 2) % WRAP_MS - WRAP_MS // 2
