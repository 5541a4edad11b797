"""A subtitle file with its film: which one, on whose clock, at which speed, through which lens."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.recordings.importers.dji.srt import read_srt
from service.recordings.importers.flight import Film, Given, ImportedFlight, ImportRefusedError
from tests.support.films import SIZE, numbered, write_film
from tests.support.srt_lines import DIALECTS, Dialect, Moment, srt_of

AT = Moment(47.0, 8.0, 60.0, 500.0, 10.0, -10.0, 0.0, 10.0)


def even_film(path: Path, count: int = 60, fps: float = 30.0) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, SIZE)
    for number in range(count):
        writer.write(numbered(number % 256))
    writer.release()
    return path


def flown(tmp_path: Path, dialect: Dialect, count: int, *films: Path, name: str = "DJI_0001") -> ImportedFlight:
    path = tmp_path / f"{name}.SRT"
    path.write_text(srt_of(dialect, [AT] * count), encoding="utf-8")
    return read_srt(path, Given(films))


def test_cues_that_are_frames_have_the_frames_own_times(tmp_path: Path) -> None:
    film = even_film(tmp_path / "DJI_0001.MP4")
    flight = flown(tmp_path, DIALECTS["Mavic 3"], 60, film)
    assert isinstance(flight.frames, Film) and flight.frames_tied and flight.camera is not None
    np.testing.assert_allclose(flight.camera.time_s, flight.frames.time_s, atol=1e-9)  # a cue's start: to 1 ms


def test_a_film_of_variable_rate_is_tied_by_its_own_stamps(tmp_path: Path) -> None:
    film = tmp_path / "DJI_0001.mp4"
    times_s = write_film(film)
    plain = DIALECTS["Mavic 3"]
    dialect = Dialect(lambda number, t, at: plain.text(number, times_s[number], at), 1e-6)
    path = tmp_path / "DJI_0001.SRT"
    cues = srt_of(dialect, [AT] * 60).split("\n\n")
    ends = [*times_s[1:], times_s[-1] + 0.15]
    clock = [f"00:00:{t:06.3f}".replace(".", ",") for t in (*times_s, ends[-1])]
    retimed = []
    for number, cue in enumerate(cues):
        lines = cue.split("\n")
        lines[1] = f"{clock[number]} --> {clock[number + 1]}"
        retimed.append("\n".join(lines))
    path.write_text("\n\n".join(retimed), encoding="utf-8")
    flight = read_srt(path, Given((film,)))
    assert flight.camera is not None and isinstance(flight.frames, Film)
    np.testing.assert_allclose(flight.camera.time_s, times_s, atol=0.002)
    np.testing.assert_allclose(flight.frames.time_s, times_s, atol=0.002)


def test_the_film_is_the_one_of_its_name_or_the_one_beside_it(tmp_path: Path) -> None:
    beside = even_film(tmp_path / "DJI_0001.MP4")
    other = even_film(tmp_path / "other.mp4")
    for films in ((), (other, beside)):
        flight = flown(tmp_path, DIALECTS["Mini 3"], 60, *films)
        assert isinstance(flight.frames, Film) and flight.frames.path == beside
    renamed = flown(tmp_path, DIALECTS["Mini 3"], 60, other, name="DJI_0002")
    assert isinstance(renamed.frames, Film) and renamed.frames.path == other
    alone = flown(tmp_path, DIALECTS["Mini 3"], 60, name="DJI_0003")
    assert alone.frames is None and any("DJI_0003.MP4" in line for line in alone.remarks.lacks)


@pytest.mark.parametrize("count", [300, 2000])
def test_another_films_subtitles_are_refused_in_one_line(count: int, tmp_path: Path) -> None:
    film = even_film(tmp_path / "DJI_0001.MP4")
    with pytest.raises(ImportRefusedError, match="another film") as refused:
        flown(tmp_path, DIALECTS["Mini 3"], count, film)
    assert "60 frames" in str(refused.value) and f"{count} cues" in str(refused.value)


def test_a_film_that_is_no_film_is_named(tmp_path: Path) -> None:
    film = tmp_path / "DJI_0001.MP4"
    film.write_bytes(b"not a film" * 100)
    with pytest.raises(ImportRefusedError, match=r"DJI_0001\.MP4"):
        flown(tmp_path, DIALECTS["Mini 3"], 60)


@pytest.mark.parametrize("ratio", [0.25, 5.0])
def test_slow_motion_and_hyperlapses_are_put_back_to_the_time_in_which_they_were_taken(
    ratio: float, tmp_path: Path
) -> None:
    film = even_film(tmp_path / "DJI_0001.MP4", 300)
    plain = DIALECTS["Mavic 3"]
    told = Dialect(lambda number, t, at: plain.text(number, t * ratio, at), 1e-6, 0.1)
    flight = flown(tmp_path, told, 300, film)
    assert isinstance(flight.frames, Film) and flight.camera is not None
    assert flight.frames.time_s[-1] == pytest.approx(299 / 30.0 * ratio, rel=1e-3)
    assert flight.camera.time_s[-1] == pytest.approx(flight.frames.time_s[-1], abs=0.05)
    assert any("not played as taken" in line for line in flight.remarks.assumed)


@pytest.mark.parametrize(
    ("focal", "zoom", "focal_mm"),
    [
        ("240", "10000, delta:0", 24.0),
        ("24.00", "1.00", 24.0),
        ("24,00", "1,00", 24.0),
        ("280", "20000, delta:0", 56.0),
        ("52.00", "1.79", 93.08),
        ("24", "10000", 24.0),
        ("1620", "10000", 162.0),
        ("162.00", "2.00", 324.0),
    ],
)
def test_focal_lengths_in_tenths_and_zooms_in_ten_thousandths(
    focal: str, zoom: str, focal_mm: float, tmp_path: Path
) -> None:
    film = even_film(tmp_path / "DJI_0001.MP4")
    plain = DIALECTS["Mavic 3"]
    told = Dialect(
        lambda number, t, at: plain.text(number, t, at).replace(
            "[focal_len: 24.00] [dzoom_ratio: 1.00]", f"[focal_len: {focal}] [dzoom_ratio: {zoom}]"
        ),
        1e-6,
    )
    lens = flown(tmp_path, told, 60, film).lens
    assert lens is not None and (lens.width, lens.height) == SIZE and lens.hfov_deg is not None
    assert lens.hfov_deg == pytest.approx(2.0 * math.degrees(math.atan(18.0 / focal_mm)), abs=1e-6)


def test_a_lens_that_zoomed_is_named_and_the_longest_used_one_taken(tmp_path: Path) -> None:
    film = even_film(tmp_path / "DJI_0001.MP4")
    plain = DIALECTS["Mavic 3"]
    told = Dialect(
        lambda number, t, at: plain.text(number, t, at).replace("24.00", "48.00" if number < 20 else "24.00"), 1e-6
    )
    flight = flown(tmp_path, told, 60, film)
    assert flight.lens is not None and flight.lens.hfov_deg == pytest.approx(73.74, abs=0.01)
    assert any("20 of 60" in line for line in flight.remarks.lacks)
    assert isinstance(flight.frames, Film) and flight.frames.is_used is not None
    np.testing.assert_array_equal(flight.frames.is_used, np.arange(60) >= 20)


def test_a_film_of_another_name_is_in_doubt(tmp_path: Path) -> None:
    for name, doubts in (("DJI_0002.MP4", 1), ("dji_0001.mp4", 0)):
        flight = flown(tmp_path, DIALECTS["Mavic 3"], 60, even_film(tmp_path / name))
        assert len(flight.remarks.doubt) == doubts, flight.remarks.doubt
