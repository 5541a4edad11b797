"""A PMTiles archive: tiles by their place, through leaves; what is broken is refused, or has no tile there."""

import contextlib
import gzip
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from service.ground.background.pmtiles import PMTiles
from service.ground.background.pmtiles_directory import directory, tile_number
from service.ground.background.tile import Tile
from service.ground.faults import GroundError


def varints(*numbers: int) -> bytes:
    out = bytearray()
    for number in numbers:
        groups = [number >> shift & 0x7F for shift in range(0, max(number.bit_length(), 1), 7)]
        out += bytes([*(one | 0x80 for one in groups[:-1]), groups[-1]])
    return bytes(out)


def packed(*entries: tuple[int, int, int, int]) -> bytes:
    """Entries of first tile, run, length, offset."""
    first, run, length, offset = zip(*entries, strict=True)
    steps = [one - before for one, before in zip(first, (0, *first), strict=False)]
    return gzip.compress(varints(len(entries), *steps, *run, *length, *(one + 1 for one in offset)), mtime=0)


def archive(
    path: Path,
    root: bytes,
    leaves: bytes = b"",
    tiles: bytes = b"",
    version: int = 3,
    kind: int = 2,
    packing: int = 2,
    metadata: bytes = b'{"attribution": "<b>us</b>"}',
) -> Path:
    told = gzip.compress(metadata)
    at = 127
    parts = []
    for part in (root, told, leaves, tiles):
        parts += [at, len(part)]
        at += len(part)
    head = struct.pack("<7sB 11Q 6B 4i B 2i", b"PMTiles", version, *parts, 0, 0, 0, 1, packing, 1, kind, 1, 3, *[0] * 7)
    path.write_bytes(head + root + told + leaves + tiles)
    return path


@pytest.fixture
def opened() -> Iterator[Callable[[Path], PMTiles]]:
    with contextlib.ExitStack() as stack:
        yield lambda path: stack.enter_context(contextlib.closing(PMTiles(path)))


def test_numbers_follow_the_hilbert_curve() -> None:
    """The specification's table of zooms 0 to 2, and its example at zoom 12."""
    assert [tile_number(*one) for one in ((0, 0, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0))] == [0, 1, 2, 3, 4]
    assert tile_number(2, 0, 0) == 5 and tile_number(12, 3423, 1763) == 19078479
    assert sorted(tile_number(3, x, y) for x in range(8) for y in range(8)) == list(range(21, 85))


def test_a_tile_is_found_through_leaves_and_runs(opened: Callable[[Path], PMTiles], tmp_path: Path) -> None:
    leaf = packed((tile_number(3, 0, 0), 1, 5, 0), (tile_number(3, 7, 0), 1, 4, 5))
    root = packed((1, 4, 3, 9), (21, 0, len(leaf), 0))  # all four of zoom 1 are the sea
    tiles = opened(archive(tmp_path / "a.pmtiles", root, leaf, b"north" + b"east" + b"sea"))
    assert (tiles.told.min_zoom, tiles.told.max_zoom, tiles.told.attribution) == (1, 3, "<b>us</b>")
    assert [tiles.tile(1, x, y) for x in (0, 1) for y in (0, 1)] == [Tile(b"sea", "image/png")] * 4
    assert tiles.tile(3, 0, 0) == Tile(b"north", "image/png") and tiles.tile(3, 7, 0) == Tile(b"east", "image/png")
    for place in ((0, 0, 0), (2, 0, 0), (3, 1, 0), (3, 8, 0), (3, -1, 0), (99, 0, 0), (3, 0, 10**30)):
        assert tiles.tile(*place) is None


def test_what_follows_its_predecessor_says_no_offset() -> None:
    found = directory(varints(2, 5, 1, 1, 1, 10, 20, 8, 0))
    assert (list(found.first), list(found.offset), list(found.length)) == ([5, 6], [7, 17], [10, 20])


ROOT = packed((0, 1, 3, 0))


@pytest.mark.parametrize(
    ("made", "words"),
    [
        ({"root": ROOT, "version": 2}, "version 2: version 3 is read"),
        ({"root": ROOT, "kind": 1}, r"tiles of type 1 \(vector\): png, jpg, webp are shown"),
        ({"root": ROOT, "packing": 3}, "compressed as 3"),
        ({"root": b"nonsense"}, "incorrect header check"),
        ({"root": b""}, "ends within a number"),
        ({"root": gzip.compress(varints(3, 1, 1))}, "a directory that is none"),
        ({"root": gzip.compress(varints(1, 1, 1, 1, 0))}, "begins nowhere"),
        ({"root": gzip.compress(b"\xff" * 40)}, "beyond 64 bits"),
        ({"root": gzip.compress(bytes(9_000_000))}, "over 4000000 bytes"),
        ({"root": ROOT, "metadata": b"[" * 100_000}, "no PMTiles archive"),
        ({"root": ROOT, "metadata": b"\xff"}, "no PMTiles archive"),
    ],
)
def test_what_is_no_such_archive_is_one_line(tmp_path: Path, made: dict, words: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(GroundError, match=words) as error:
        PMTiles(archive(tmp_path / "a.pmtiles", **made))
    assert "\n" not in str(error.value) and "a.pmtiles" in str(error.value)


def test_an_archive_that_is_cut_off_or_turned_over_ends_nothing(tmp_path: Path) -> None:
    leaf = packed((tile_number(3, 0, 0), 1, 5, 0))
    whole = archive(tmp_path / "a.pmtiles", packed((0, 1, 3, 5), (21, 0, len(leaf), 0)), leaf, b"northsea").read_bytes()
    path = tmp_path / "b.pmtiles"
    for at in range(len(whole)):
        for data in (whole[:at], whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :]):
            path.write_bytes(data)
            try:
                tiles = PMTiles(path)
            except GroundError:
                continue
            with contextlib.closing(tiles):
                for place in ((0, 0, 0), (3, 0, 0), (3, 7, 7)):
                    tiles.tile(*place)


def test_leaves_that_lead_in_a_ring_end(opened: Callable[[Path], PMTiles], tmp_path: Path) -> None:
    ring = packed((0, 0, len(packed((0, 0, 25, 0))), 0))  # a leaf that is its own leaf
    assert opened(archive(tmp_path / "a.pmtiles", ring, ring)).tile(0, 0, 0) is None
