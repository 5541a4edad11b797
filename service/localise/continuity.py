"""Whether what was kept before a restart still holds: the same flight, lately, near by. The track keeper asks.

Three clocks are compared, for each alone can be wrong: the host's, which goes on over a restart of the process but not
of the host; UTC by GPS; and the autopilot's time since its boot, which tells one flight from the next. The host's own
calendar is not among them: a computer without a battery wakes up in the past.
"""

from pathlib import Path

import msgspec

from distloc.backports import StrEnum

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
REBOOT_S = 5.0  # that the autopilot's clock and another may differ by
_FUTURE_S = 1.0
_FASTEST_MPS, _NEAR_M = 100.0, 500.0  # a fixed-wing drone in the wind; what a position may jump when GPS comes back


class Refusal(StrEnum):
    """Why targets were not taken up again."""

    UNREADABLE = "unreadable"
    DAMAGED = "damaged"
    OTHER_VERSION = "other_version"
    OTHER_VEHICLE = "other_vehicle"
    OTHER_SETTINGS = "other_settings"
    NO_CLOCK = "no_clock"
    FUTURE = "future"
    STALE = "stale"
    OTHER_FLIGHT = "other_flight"
    OUT_OF_REACH = "out_of_reach"


class Moment(msgspec.Struct, frozen=True):
    """One instant on each clock; `boot_id` is that of the host, `utc_s` None while GPS has not said it."""

    boot_id: str
    monotonic_s: float
    autopilot_s: float
    utc_s: float | None


def host_boot_id() -> str:
    """Another string at each boot of the host; empty where there is none."""
    try:
        return BOOT_ID.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return ""


def elapsed_s(then: Moment, now: Moment) -> float | None:
    """Seconds between two moments; None where they share no clock that tells."""
    if then.boot_id and then.boot_id == now.boot_id:
        return now.monotonic_s - then.monotonic_s
    if then.utc_s is not None and now.utc_s is not None:
        return now.utc_s - then.utc_s
    return None


def refusal(then: Moment, now: Moment, max_age_s: float, moved_m: float) -> Refusal | None:
    """Why what was kept `then` does not hold `now`, the camera being `moved_m` from where it was; None if it does."""
    passed_s = elapsed_s(then, now)
    if passed_s is None:
        return Refusal.NO_CLOCK
    if not passed_s >= -_FUTURE_S:
        return Refusal.FUTURE
    if not passed_s <= max_age_s:
        return Refusal.STALE
    if not abs(now.autopilot_s - then.autopilot_s - passed_s) <= REBOOT_S:
        return Refusal.OTHER_FLIGHT
    if not moved_m <= _NEAR_M + _FASTEST_MPS * max(passed_s, 0.0):
        return Refusal.OUT_OF_REACH
    return None
