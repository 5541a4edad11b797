"""Metadata with any values in any order: a flight or one line, never anything else."""

import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from service.common import st0601
from service.recordings.importers.flight import Given, ImportRefusedError
from service.recordings.importers.misb.reading import read_misb
from tests.support.misb_films import write_film

PICTURES = [np.full((32, 48, 3), 3 * i, np.uint8) for i in range(12)]
TAGS = sorted(st0601.ITEMS)


def packet(items: dict[int, bytes]) -> bytes:
    """Any bytes as any item's value, with a checksum that is right: what a broken encoder sends."""
    body = b"".join(
        (bytes((0x80 | tag >> 7, tag & 0x7F)) if tag > 127 else bytes((tag,))) + bytes((len(raw),)) + raw
        for tag, raw in items.items()
    )
    size = len(body) + 4  # at most 12 items of 12 bytes
    length = bytes((size,)) if size < 0x80 else bytes((0x81, size))
    whole = st0601.KEY + length + body + b"\x01\x02"
    return whole + struct.pack(">H", st0601.checksum(whole))


_VALUES = st.dictionaries(st.sampled_from(TAGS), st.binary(max_size=9) | st.binary(min_size=4, max_size=4), max_size=12)
_STAMPS = st.integers(0, 2**64 - 1) | st.integers(1_780_000_000_000_000, 1_780_000_100_000_000)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(_STAMPS, _VALUES), min_size=1, max_size=12), st.sampled_from(["sync", "async"]))
def test_any_values(rows: list[tuple[int, dict[int, bytes]]], carriage: str) -> None:
    def next_packet(_: float) -> bytes:
        stamp_us, values = next(told)
        return packet({**values, 2: stamp_us.to_bytes(8, "big")})

    def endless() -> Iterator[tuple[int, dict[int, bytes]]]:
        while True:
            yield from rows

    told = endless()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.ts"
        write_film(path, PICTURES, next_packet, "async" if carriage == "async" else "sync")
        try:
            flight = read_misb(path, Given())
        except ImportRefusedError as error:
            assert "\n" not in str(error) and str(path) in str(error)
            return
    assert flight.frames is not None and np.isfinite(flight.frames.time_s).all()
    for one in (flight.craft, flight.camera, flight.positions):
        assert one is None or (np.isfinite(one.time_s).all() and (np.diff(one.time_s) > 0.0).all())
