"""ISO 8601 as each Python must read it; that of 3.10 reads a part of it by itself."""

from datetime import datetime, timedelta, timezone

import pytest

from service.common.iso_time import moment_from_iso


@pytest.mark.parametrize(
    ("text", "microsecond", "zone_h"),
    [
        ("2026-07-14T09:30:00Z", 0, 0.0),
        ("2026-07-14t09:30:00z", 0, 0.0),
        ("2026-07-14 09:30:00", 0, None),
        ("2026-07-14T09:30", 0, None),
        ("2026-07-14T09:30:00.1Z", 100_000, 0.0),
        ("2026-07-14T09:30:00,25+0200", 250_000, 2.0),
        ("2026-07-14T09:30:00.123456789-03:30", 123_456, -3.5),
        ("20260714T093000+02", 0, 2.0),
        (" 2026-07-14 09:30:00 +02:00 ", 0, 2.0),
    ],
)
def test_fractions_and_zones_of_any_length(text: str, microsecond: int, zone_h: float | None) -> None:
    zone = None if zone_h is None else timezone(timedelta(hours=zone_h))
    found = moment_from_iso(text)
    assert found == datetime(2026, 7, 14, 9, 30, 0, microsecond, tzinfo=zone)
    assert found.utcoffset() == (None if zone is None else timedelta(hours=zone_h or 0.0))


def test_a_date_is_its_midnight() -> None:
    assert moment_from_iso("2026-07-14") == datetime(2026, 7, 14)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "today",
        "14.07.2026 09:30",
        "2026-13-01T00:00Z",
        "2026-02-30",
        "2026-07-14T24:30",
        "2026-07-14T09:30:60Z",
        "2026-07-14T09",
        "2026-07-14T09:30+24:00",
        "2026-07-14T09:30Z" * 1000,
        "٢٠٢٦-07-14",
        "2026-07-14+02:00",
    ],
)
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r".") as caught:
        moment_from_iso(text)
    assert len(str(caught.value)) < 200
