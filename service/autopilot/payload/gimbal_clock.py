"""When a gimbal was turned as it says, on the autopilot's time since boot; for `gimbal`.

A gimbal that is a component of its own stamps by a clock of its own. Its arrivals bound the offset from above, as they
do for an autopilot that never answers TIMESYNC.
"""

from service.autopilot.boot_clock import BootClock
from service.autopilot.timesync import Timesync

AHEAD_NS = 100_000_000  # a stamp may lie so far after its arrival, by the offset's own error,
LATE_NS = 5_000_000_000  # and so far before it, on a link that is full


class GimbalClock:
    """One gimbal's clock; `is_by_arrival` says whether the last time was found by arrivals alone."""

    def __init__(self) -> None:
        self.is_by_arrival = False
        self.clear()

    def clear(self) -> None:
        """Forget the clock."""
        self._boot = BootClock()
        self._offset = Timesync()

    def stamp_ns(self, own_ms: int, vehicle_boot_ns: int | None, now_boot_ns: int) -> int | None:
        """Time since the autopilot's boot of an attitude stamped `own_ms` (0: not stamped) that arrived now.

        `vehicle_boot_ns` is that stamp if it is the autopilot's clock's. None while a restart is suspected.
        """
        if vehicle_boot_ns is not None and -AHEAD_NS <= now_boot_ns - vehicle_boot_ns <= LATE_NS and own_ms:
            self.is_by_arrival = False
            return vehicle_boot_ns
        self.is_by_arrival = True
        if not own_ms:
            return now_boot_ns
        own_ns = self._boot.update(own_ms, now_boot_ns)
        if self._boot.take_reboot():
            self._offset.reset()
        if own_ns is None:
            return None
        self._offset.observe_boot(own_ns, now_boot_ns)
        offset_ns = self._offset.offset_ns()
        return None if offset_ns is None else own_ns + offset_ns
