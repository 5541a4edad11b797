"""The transport stream beside a writer that is not ours; and cut, spoiled, repeated and made up."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stanag4609.transport import encode_metadata_au_cell
from stanag4609.transport.metadata import CellFragmentation

from service.recordings.importers.flight import ImportRefusedError
from service.recordings.importers.misb import mpegts
from service.recordings.importers.misb.mpegts import PACKET, Contents, has_klv, read_contents, stride_of
from service.recordings.importers.misb.pes import cells
from tests.support.misb_films import Carriage, klv, write_film

START_US = 1_780_000_000_000_000
PICTURES = [np.full((64, 96, 3), 4 * i, np.uint8) for i in range(30)]


@pytest.fixture(scope="module", params=["sync", "async"])
def film(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Carriage]:
    path = tmp_path_factory.mktemp("films") / f"{request.param}.ts"
    write_film(path, PICTURES, lambda shown_s: klv({2: START_US + round(shown_s * 1e6)}), request.param)
    return path, request.param


def spoiled(film: tuple[Path, Carriage], tmp_path: Path, data: bytes) -> Contents:
    path = tmp_path / "spoiled.ts"
    path.write_bytes(data)
    return read_contents(path)


def test_all_metadata_and_all_pictures_times_are_found(film: tuple[Path, Carriage]) -> None:
    path, carriage = film
    found = read_contents(path)
    assert (len(found.units), len(found.picture_pts_s), found.is_sync, found.lost) == (30, 30, carriage == "sync", 0)
    assert np.diff(sorted(found.picture_pts_s)) == pytest.approx(np.full(29, 0.04))
    assert all((unit.pts_s is not None) == (carriage == "sync") for unit in found.units)
    assert [unit.video_pts_s for unit in found.units] == found.picture_pts_s
    assert has_klv(path.read_bytes()[:65_536])


@pytest.mark.parametrize("stride", [192, 204])
def test_longer_packets_are_read_as_well(film: tuple[Path, Carriage], tmp_path: Path, stride: int) -> None:
    data = film[0].read_bytes()
    packets = [data[at : at + PACKET] for at in range(0, len(data), PACKET)]
    extra = bytes(stride - PACKET)
    longer = b"".join(extra + one for one in packets) if stride == 192 else b"".join(one + extra for one in packets)
    assert stride_of(longer[:4000]) == (stride, len(extra) if stride == 192 else 0)
    assert len(spoiled(film, tmp_path, longer).units) == 30


def test_junk_between_packets_costs_only_what_it_hits(film: tuple[Path, Carriage], tmp_path: Path) -> None:
    data = film[0].read_bytes()
    middle = len(data) // 2 // PACKET * PACKET
    found = spoiled(film, tmp_path, data[:middle] + b"\x47junk" * 31 + data[middle + 40 :])
    assert 26 <= len(found.units) <= 30
    assert 26 <= len(found.picture_pts_s) <= 30


def test_a_cut_film_has_what_it_still_holds(film: tuple[Path, Carriage], tmp_path: Path) -> None:
    data = film[0].read_bytes()
    found = spoiled(film, tmp_path, data[: len(data) // 2 + 77])
    assert 10 <= len(found.units) < 30


def test_a_film_that_begins_in_the_middle_of_a_packet_is_found_its_step(
    film: tuple[Path, Carriage], tmp_path: Path
) -> None:
    data = film[0].read_bytes()
    assert stride_of(data[100:3000]) == (PACKET, 88)
    tables = data[: 2 * PACKET]
    found = spoiled(film, tmp_path, data[100:PACKET] + tables + data[2 * PACKET :])
    assert len(found.units) == 30


def test_lost_packets_cost_their_metadata_and_are_counted(film: tuple[Path, Carriage], tmp_path: Path) -> None:
    path = tmp_path / "long.ts"
    write_film(path, PICTURES, lambda s: klv({2: START_US, 3: "a" * 127, 4: "b" * 127, 10: "c" * 127}), film[1])
    data = path.read_bytes()
    packets = [data[at : at + PACKET] for at in range(0, len(data), PACKET)]
    of_klv = [i for i, one in enumerate(packets) if (one[1] & 0x1F) << 8 | one[2] == 0x200]
    middles = [i for i in of_klv if not packets[i][1] & 0x40]
    assert len(middles) >= 30
    kept = [one for i, one in enumerate(packets) if i not in middles[3:6]]
    found = spoiled(film, tmp_path, b"".join(kept))
    assert found.lost >= 1
    assert 24 <= len(found.units) < 30


def test_a_time_stamp_of_33_bits_that_is_over_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "over.ts"
    write_film(path, PICTURES, lambda s: klv({2: START_US + round(s * 1e6)}), "sync", shift_pts=2**33 - 90_000 * 2)
    found = read_contents(path)
    assert np.ptp(found.picture_pts_s) == pytest.approx(29 * 0.04)
    assert np.ptp([unit.pts_s or 0.0 for unit in found.units]) == pytest.approx(29 * 0.04)


def test_a_unit_in_several_cells_is_put_together() -> None:
    parts = ((b"one", CellFragmentation.FIRST), (b"two", CellFragmentation.MIDDLE), (b"end", CellFragmentation.LAST))
    parts_of = [
        encode_metadata_au_cell(data, sequence_number=i, fragmentation=kind) for i, (data, kind) in enumerate(parts)
    ]
    whole = encode_metadata_au_cell(b"alone", sequence_number=3, fragmentation=CellFragmentation.COMPLETE)
    assert cells(b"".join(parts_of) + whole) == [b"onetwoend", b"alone"]


def test_more_than_may_be_held_is_refused(film: tuple[Path, Carriage], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mpegts, "MOST_UNITS", 10)
    with pytest.raises(ImportRefusedError, match="cut it"):
        read_contents(film[0])


def test_what_is_no_transport_stream_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "no.ts"
    path.write_bytes(bytes(5000))
    with pytest.raises(ImportRefusedError, match="is no MPEG-TS"):
        read_contents(path)
    assert not has_klv(path.read_bytes())


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 10_000_000), st.integers(0, 255)), max_size=40), st.integers(0, 10_000_000))
def test_spoiled_bytes_are_never_more_than_refused(changes: list[tuple[int, int]], end: int) -> None:
    data = bytearray(_plain())
    for at, value in changes:
        data[at % len(data)] = value
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.ts"
        path.write_bytes(data[: 1000 + end % len(data)])
        try:
            found = read_contents(path)
        except ImportRefusedError:
            return
    assert len(found.units) <= 31
    assert all(len(unit.data) <= mpegts.MOST_PES_BYTES for unit in found.units)


def _plain(_kept: list[bytes] = []) -> bytes:  # noqa: B006
    if not _kept:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "plain.ts"
            write_film(path, PICTURES, lambda s: klv({2: START_US}), "sync")
            _kept.append(path.read_bytes())
    return _kept[0]
