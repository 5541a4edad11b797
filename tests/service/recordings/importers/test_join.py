"""Parts of a flight to one: by their dates, by releases of the camera, and what does not belong together."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.recordings.importers.flight import (
    Attitudes,
    Film,
    ImportedFlight,
    ImportRefusedError,
    Lens,
    Positions,
    Remarks,
    Stills,
    unknown,
)
from service.recordings.importers.join import check_overlap, joined, released, time_span

TIMES_S = np.arange(0.0, 10.0, 0.5)


def placed(epoch_s: float | None, lat_deg: float = 47.0) -> ImportedFlight:
    count = len(TIMES_S)
    positions = Positions(
        TIMES_S,
        np.full(count, lat_deg),
        np.full(count, 8.0),
        np.zeros(count),
        *(unknown(count),) * 2,
        unknown(count, 3),
    )
    return ImportedFlight("places", epoch_s, positions=positions, remarks=Remarks(found=["a place"]))


def turned(epoch_s: float | None) -> ImportedFlight:
    q = np.repeat([[1.0, 0.0, 0.0, 0.0]], len(TIMES_S), axis=0)
    return ImportedFlight("turns", epoch_s, craft=Attitudes(TIMES_S, q, unknown(len(TIMES_S), 3)))


def filmed(epoch_s: float | None, is_tied: bool) -> ImportedFlight:
    film = Film(Path("a.mp4"), np.arange(0.0, 5.0, 0.1))
    return ImportedFlight("film", epoch_s, lens=Lens(64, 48), frames=film, frames_tied=is_tied)


def test_parts_with_dates_are_put_on_one_clock() -> None:
    flight = joined([placed(1000.0), turned(1002.5), filmed(1001.0, True)])
    assert flight.epoch_s == 1000.0 and flight.craft is not None and flight.frames is not None
    assert flight.craft.time_s[0] == 2.5 and flight.frames.time_s[0] == 1.0
    assert flight.frames_tied and flight.remarks.found == ["places: a place"]
    assert time_span(flight) == (0.0, 12.0)


def test_a_film_that_is_tied_to_nothing_keeps_its_own_clock() -> None:
    flight = joined([placed(1000.0), filmed(5.0, False)])
    assert flight.frames is not None and flight.frames.time_s[0] == 0.0 and not flight.frames_tied


def test_what_is_told_twice_comes_from_the_first_and_is_said() -> None:
    flight = joined([placed(1000.0, 47.0), replace(placed(1000.0, 12.0), source="others")])
    assert flight.positions is not None and flight.positions.lat_deg[0] == 47.0
    assert flight.remarks.assumed == ["the place of places, not of others"]


def test_poses_with_and_without_a_date_do_not_belong_together() -> None:
    with pytest.raises(ImportRefusedError, match="times without a date beside a source that has one"):
        joined([placed(1000.0), turned(None)])
    assert "none has a date" in joined([placed(None), turned(None)]).remarks.assumed[0]


def test_the_size_of_the_film_and_the_lens_of_the_log() -> None:
    log = replace(placed(1000.0), lens=Lens(1920, 1080, fx=1500.0))
    assert joined([filmed(None, False), log]).lens == Lens(64, 48, fx=1500.0 * 64 / 1920)


@pytest.mark.parametrize(
    ("late_s", "says"),
    [(7200.0, r"2\.00 h after .* --utc-offset"), (-3600.0, r"1\.00 h before"), (900.0, "one flight")],
)
def test_frames_apart_from_all_poses_are_refused(late_s: float, says: str) -> None:
    with pytest.raises(ImportRefusedError, match=says):
        check_overlap(joined([placed(10_000.0), filmed(10_000.0 + late_s, True)]))
    check_overlap(joined([placed(10_000.0), filmed(10_001.0, True)]))


def test_pictures_in_the_order_of_their_own_times_by_releases() -> None:
    paths = [Path(name) for name in ("b.jpg", "a.jpg", "c.jpg")]
    camera = ImportedFlight("p", None, frames=Stills(paths, np.array([7.0, 3.0, 9.0])), frames_tied=False)
    log = replace(placed(1000.0), triggers_s=np.array([1.0, 2.0, 3.0]))
    flight = released(joined([log, camera]))
    assert isinstance(flight.frames, Stills) and flight.frames_tied
    assert [path.name for path in flight.frames.paths] == ["a.jpg", "b.jpg", "c.jpg"]
    assert flight.frames.time_s.tolist() == [1.0, 2.0, 3.0]
    fewer = released(joined([replace(log, triggers_s=np.array([1.0, 2.0])), camera]))
    assert not fewer.frames_tied  # their own times may still be tied by turning
    unknown_times = replace(camera, frames=Stills(paths, np.full(3, np.nan)))
    with pytest.raises(ImportRefusedError, match="no log tells"):
        released(joined([placed(1000.0), unknown_times]))


def test_poses_days_apart_are_no_flight() -> None:
    with pytest.raises(ImportRefusedError, match="at most 48 h"):
        time_span(joined([placed(1000.0), turned(1000.0 + 3e5)]))
