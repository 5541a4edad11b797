"""Telemetry that is spoiled, NaN, of other widths and clocks: a flight or one line, never anything else."""

import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.recordings.importers.flight import Given, ImportedFlight, ImportRefusedError
from service.recordings.importers.gopro.reading import read_gopro
from tests.support.gopro_films import device, element, nested, stream, text, write_film

PICTURES = [np.full((16, 32, 3), i, np.uint8) for i in range(20)]
NAN, HUGE = float("nan"), 3e38


def attd(rows: list[tuple[float, ...]]) -> bytes:
    return nested("STRM", element("ATTD", "f", rows, "f" * len(rows[0])))


def glpi(rows: list[tuple[float, ...]]) -> bytes:
    return nested("STRM", element("GLPI", "d", rows, "d" * len(rows[0])))


def read(payloads: list[bytes], by_course: bool = True) -> ImportedFlight | None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.mp4"
        write_film(path, PICTURES, payloads)
        try:
            return read_gopro(path, Given(by_course=by_course))
        except ImportRefusedError as error:
            assert "\n" not in str(error) and str(path) in str(error)
            return None


GOOD_ATTITUDE, GOOD_PLACE = (10.25, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0), (10.25, 47.4, 8.5, 500.0, 20.0, 1.0, 2.0, 0.0, 90.0)


def test_one_bad_stamp_or_number_costs_its_own_row() -> None:
    attitudes = [(10.0 + 0.25 * i, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0) for i in range(4)]
    attitudes[1] = (NAN, *attitudes[1][1:])
    attitudes[2] = (attitudes[2][0], NAN, *attitudes[2][2:])
    places = [(10.0 + 0.25 * i, 47.4, 8.5, 500.0, 20.0, 1.0, 2.0, 0.0, 90.0) for i in range(4)]
    places[3] = (places[3][0], 95.0, *places[3][2:])
    flight = read([device("GoPro Karma", attd(attitudes), glpi(places))])
    assert flight is not None and flight.craft is not None and flight.positions is not None
    assert (len(flight.craft.time_s), len(flight.positions.time_s)) == (2, 3)
    assert flight.remarks.dropped["craft's attitude: no time"] == 1
    assert flight.remarks.dropped["craft's attitude: not a number"] == 1
    assert flight.remarks.dropped["position: no place on earth"] == 1


@pytest.mark.parametrize(
    "payloads",
    [
        [device("K", attd([(NAN,) * 7]), glpi([(NAN,) * 9]))],
        [device("K", attd([(1.0, 2.0)]), glpi([(1.0, 2.0)]))],
        [device("K", attd([(HUGE,) * 7]), glpi([(1e308,) * 9]))],
        [device("K", attd([GOOD_ATTITUDE]), glpi([GOOD_PLACE])), b"junk" * 9, b"\0\0\0\0"],
        [device("K", stream("CORI", np.zeros((3, 4)), 1.0), stream("GRAV", np.zeros((3, 3)), 1.0))],
        [device("K", stream("CORI", np.ones((3, 2)), 1.0), stream("GRAV", np.ones((3, 1)), 1.0))],
        [device("K", nested("STRM", text("GPSU", "9" * 40), element("GPS5", "d", [(NAN,) * 5], "ddddd")))],
        [device("K", nested("STRM", element("GPS9", "d", [(NAN,) * 9], "d" * 9)))],
        [
            device(
                "K", nested("STRM", element("SYST", "d", [(NAN, NAN)], "dd")), attd([GOOD_ATTITUDE]), glpi([GOOD_PLACE])
            )
        ],
    ],
)
def test_nonsense_is_a_flight_without_it_or_refused(payloads: list[bytes]) -> None:
    flight = read(payloads)
    if flight is not None:
        for one in (flight.craft, flight.camera, flight.positions):
            assert one is None or np.isfinite(one.time_s).all()


_ROWS = st.lists(
    st.tuples(*[st.floats(width=32) | st.floats(-1.0, 1.0, width=32) | st.sampled_from([NAN, HUGE, 0.0])] * 9),
    min_size=1,
    max_size=6,
)


@settings(max_examples=40, deadline=None)
@given(_ROWS, _ROWS, st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 255)), max_size=5))
def test_any_numbers_and_spoiled_bytes(
    first: list[tuple[float, ...]], second: list[tuple[float, ...]], changes: list[tuple[int, int]]
) -> None:
    def one(key: str, rows: list[tuple[float, ...]], width: int) -> bytes:
        return nested("STRM", element(key, "f", [row[:width] for row in rows], "f" * width))

    keys = (("ATTD", 7), ("GLPI", 9), ("CYTS", 9), ("SYST", 2), ("GPS5", 5), ("GPS9", 9), ("CORI", 4), ("GRAV", 3))
    data = bytearray(device("K", *(one(key, first, width) for key, width in keys)))
    for at, value in changes:
        data[at % len(data)] = value
    more = device("K", *(one(key, second, width) for key, width in reversed(keys)))
    plain = device("K", *(one(key, first, width) for key, width in keys if key not in ("ATTD", "GLPI")))
    assert struct.calcsize("f") == 4
    for payloads in ([bytes(data), more], [plain, more]):
        flight = read(payloads)
        if flight is not None and flight.positions is not None:
            assert (np.diff(flight.positions.time_s) > 0.0).all()
