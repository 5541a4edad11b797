"""The telemetry's track in films whole, cut and spoiled."""

import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.recordings.importers.flight import ImportRefusedError
from service.recordings.importers.gopro.mp4_track import has_telemetry, payloads, read_track
from tests.support.gopro_films import device, stream, write_film
from tests.support.places import DATA

PICTURES = [np.full((48, 64, 3), 5 * i, np.uint8) for i in range(50)]
PAYLOADS = [device("Camera", stream("GYRO", np.full((20, 3), 0.1 * i), 939.0)) for i in range(2)]
KARMA = DATA / "karma" / "karma.mp4"


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("films") / "film.mp4"
    write_film(path, PICTURES, PAYLOADS)
    return path


def test_the_payloads_come_back_with_their_times(film: Path) -> None:
    assert has_telemetry(film)
    track = read_track(film)
    assert list(payloads(film, track)) == PAYLOADS
    assert track.times_s.tolist() == [0.0, 1.0, 2.0]


def test_a_film_without_such_a_track_is_said_to_have_none(tmp_path: Path) -> None:
    path = tmp_path / "plain.mp4"
    write_film(path, PICTURES, PAYLOADS)
    path.write_bytes(path.read_bytes().replace(b"gpmd", b"gpmx"))
    assert not has_telemetry(path)
    with pytest.raises(ImportRefusedError, match="has no track of GPMF"):
        read_track(path)


def test_a_cut_film_has_the_payloads_that_it_still_holds(film: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mp4"
    path.write_bytes(film.read_bytes()[:-10])
    assert list(payloads(path, read_track(path))) == [PAYLOADS[0], b""]


@pytest.mark.parametrize(
    ("box", "at", "value", "said"),
    [
        (b"stsz", 12, 0xFFFFFFFF, "'stsz' says"),
        (b"stsz", 16, 0x7FFFFFFF, "a sample of"),
        (b"stco", 8, 0xFFFFFFFF, "'stco' says"),
        (b"stsc", 12, 5, "'stsc' does not"),
        (b"stts", 12, 1, "'stts' has times for fewer"),
        (b"stts", 8, 200_001, "'stts' says"),
        (b"stco", 8, 1, "fewer samples"),
    ],
)
def test_a_table_that_lies_is_named(film: Path, tmp_path: Path, box: bytes, at: int, value: int, said: str) -> None:
    data = bytearray(film.read_bytes())
    start = data.rindex(box) + 4 + at - 4
    struct.pack_into(">I", data, start, value)
    path = tmp_path / "lies.mp4"
    path.write_bytes(data)
    with pytest.raises(ImportRefusedError, match=said):
        read_track(path)


def test_a_cut_index_is_named(film: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mp4"
    data = film.read_bytes()
    path.write_bytes(data[: data.rindex(b"stbl")])
    assert not has_telemetry(path)
    with pytest.raises(ImportRefusedError, match="'moov' says"):
        read_track(path)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1_000_000), st.integers(0, 255)), max_size=20), st.integers(0, 1_000_000))
def test_spoiled_bytes_are_never_more_than_refused(changes: list[tuple[int, int]], end: int) -> None:
    data = bytearray(_whole())
    index = data.rindex(b"moov")  # all that counts is in there
    for at, value in changes:
        data[index + at % (len(data) - index)] = value
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.mp4"
        path.write_bytes(data[: len(data) - end % 2000 if end % 3 == 0 else None])
        has_telemetry(path)
        try:
            found = list(payloads(path, read_track(path)))
        except ImportRefusedError:
            return
        assert sum(map(len, found)) <= 2 * len(data)


def _whole(_kept: list[bytes] = []) -> bytes:  # noqa: B006
    if not _kept:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "f.mp4"
            write_film(path, PICTURES, PAYLOADS)
            _kept.append(path.read_bytes())
    return _kept[0]


@pytest.mark.skipif(not KARMA.is_file(), reason="no shared data")
def test_a_real_film_has_thirteen_payloads_of_a_second() -> None:
    track = read_track(KARMA)
    assert track.times_s == pytest.approx(1.001 * np.arange(14))
    assert all(one.startswith(b"DEVC") for one in payloads(KARMA, track))
