"""Turns the 32-bit `time_boot_ms` into a time that never wraps and notices a reboot; used by the autopilot."""

WRAP_MS = 1 << 32
BACK_MS = 1_000
AHEAD_MS = 60_000  # how much faster than the host's clock it may run: a full link that empties
EVEN_MS = 1_000  # by which one step may be longer than the host's clock says
CONFIRM_SAMPLES = 3


class BootClock:
    """Unwraps times since boot; a step that neither age nor wrap explains counts as a reboot once confirmed."""

    def __init__(self) -> None:
        self._reference_ms: int | None = None
        self._rebooted = False
        self.reset()

    def reset(self) -> None:
        """Forget the time: the autopilot restarted."""
        self._last_ms: int | None = None
        self._last_now_ns = 0
        self._odd = 0
        self._ahead: tuple[int, int, int] | None = None  # time, its arrival, how many agreed
        self._reference_ms = None

    def update(self, boot_ms: int, now_ns: int) -> int | None:
        """Nanoseconds since boot of a message that arrived now; None while a reboot is suspected."""
        if self._last_ms is None:
            self._last_ms, self._last_now_ns = self._nearest_ms(boot_ms), now_ns
            return self._last_ms * 1_000_000
        step_ms = _signed(boot_ms - self._last_ms)
        elapsed_ms = (now_ns - self._last_now_ns) // 1_000_000
        if -BACK_MS <= step_ms <= elapsed_ms * 2 + AHEAD_MS:
            if step_ms > elapsed_ms + EVEN_MS and not self._is_borne_out(boot_ms, now_ns):
                return None
            value_ms = self._last_ms + step_ms
            if step_ms > 0:
                self._last_ms, self._last_now_ns, self._odd = value_ms, now_ns, 0
            return value_ms * 1_000_000
        self._odd += 1
        if self._odd < CONFIRM_SAMPLES:
            return None
        self.reset()
        self._last_ms, self._last_now_ns, self._rebooted = boot_ms, now_ns, True
        return boot_ms * 1_000_000

    def _is_borne_out(self, boot_ms: int, now_ns: int) -> bool:
        """Whether a time that is far ahead is the last of several that agree: a single one changes nothing."""
        last, count = self._ahead, 0
        if last is not None:
            elapsed_ms = (now_ns - last[1]) // 1_000_000
            count = last[2] if -BACK_MS <= _signed(boot_ms - last[0]) <= elapsed_ms + EVEN_MS else 0
        self._ahead = (boot_ms, now_ns, count + 1)
        return count + 1 >= CONFIRM_SAMPLES

    def peek(self, boot_ms: int) -> int | None:
        """Nanoseconds since boot of a time near the last; None if there is none or it is far from it."""
        if self._last_ms is None:
            return None
        step_ms = _signed(boot_ms - self._last_ms)
        return (self._last_ms + step_ms) * 1_000_000 if abs(step_ms) <= AHEAD_MS else None

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

    def _nearest_ms(self, boot_ms: int) -> int:
        if self._reference_ms is None:
            return boot_ms
        nearest_ms = self._reference_ms + _signed(boot_ms - self._reference_ms)
        return nearest_ms if nearest_ms >= 0 else boot_ms


def _signed(difference_ms: int) -> int:
    """A difference of 32-bit counters in [-2^31, 2^31)."""
    return (difference_ms + WRAP_MS // 2) % WRAP_MS - WRAP_MS // 2
