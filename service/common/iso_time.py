"""Times in ISO 8601, read alike by every Python: 3.10's own reader knows neither Z nor most fractions and zones."""

import re
from datetime import datetime, timedelta, timezone

_ISO = re.compile(
    r"(\d{4})-?(\d\d)-?(\d\d)"
    r"(?:[T ](\d\d):?(\d\d)(?::?(\d\d)(?:[.,](\d{1,18}))?)?(?: ?(?:(Z)|([+-])(\d\d)(?::?(\d\d))?))?)?",
    re.ASCII | re.IGNORECASE,
)


def moment_from_iso(text: str) -> datetime:
    """A time with its zone, or without one where the text has none; a date alone is its midnight.

    Fractions may have any number of digits, of which six are kept, zones be as Z, +02, +0200 or +02:00. ValueError for
    what is no time.
    """
    found = _ISO.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"must be ISO 8601, as 2026-07-14T09:30:00Z, got {text[:40]!r}")
    year, month, day, hour, minute, second, fraction, is_utc, sign, zone_h, zone_min = found.groups()
    zone = timezone.utc if is_utc else None
    if sign:
        ahead = timedelta(hours=int(zone_h), minutes=int(zone_min or 0))
        zone = timezone(-ahead if sign == "-" else ahead)
    whole = (int(one or 0) for one in (year, month, day, hour, minute, second))
    return datetime(*whole, int((fraction or "0")[:6].ljust(6, "0")), tzinfo=zone)  # type: ignore[misc, arg-type]
