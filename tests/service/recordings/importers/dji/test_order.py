"""Which number is the latitude: told by letters, range and distances, else assumed aloud or refused."""

import math

import numpy as np
import pytest

from service.recordings.importers.dji.order import places_of
from service.recordings.importers.dji.words import words_of
from service.recordings.importers.flight import ImportRefusedError, Remarks

LAT, LON = 61.4983, 23.7603  # no range tells which is which


def places(*texts: str) -> tuple[float, float, Remarks]:
    remarks = Remarks()
    rows = [words_of(text) for text in texts]
    found = places_of("a.SRT", rows, np.arange(len(rows)) * 1.0, remarks)
    return float(found.lat_deg[0]), float(found.lon_deg[0]), remarks


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("GPS(E: 23.7603, N: 61.4983, 12.00m)", (LAT, LON)),
        ("GPS(S: 61.4983, W: 23.7603, 12.00m)", (-LAT, -LON)),
        ("GPS(149.0251,-20.2533,16) BAROMETER:1.9", (-20.2533, 149.0251)),
        ("GPS(-41.3899,174.0177,0.0M) BAROMETER:97.7M", (-41.3899, 174.0177)),
        ("GPS(39.906217,116.391305,69.800) BAROMETER(91.2)", (39.906217, 116.391305)),
        ("GPS(12.5, 41.9, 7) HOME(112.5, 41.9)", (41.9, 12.5)),  # home's range tells both
        ("GPS(149,0251, -20,2533, 16) BAROMETER:1,9", (-20.2533, 149.0251)),
        ("GPS(149,0251; -20,2533; 16) BAROMETER:1,9", (-20.2533, 149.0251)),
        ("[latitude: 61.4983] [longitude: 23.7603]", (LAT, LON)),
        ("[latitude: 116.39] [longitude: 39.9]", (39.9, 116.39)),
    ],
)
def test_what_letters_names_and_range_tell(text: str, expected: tuple[float, float]) -> None:
    assert places(text)[:2] == pytest.approx(expected)


def test_a_swap_under_the_names_is_said() -> None:
    assert any("swapped" in line for line in places("[latitude: 116.39] [longitude: 39.9]")[2].assumed)


@pytest.mark.parametrize(("first", "second"), [(LON, LAT), (LAT, LON)])
@pytest.mark.parametrize("how", ["D", "H.S"])
def test_distances_tell_the_order_either_way(how: str, first: float, second: float) -> None:
    """At 61 degrees north a degree of longitude is half as long: 10 m/s to the east."""
    texts = []
    for second_s in range(1, 12):
        lon_deg = LON + 10.0 * second_s / 111_195.0 / math.cos(math.radians(LAT))
        pair = (lon_deg, LAT) if first == LON else (LAT, lon_deg)
        told = f"HOME ({first}, {second}, 0.0m), D {10.0 * second_s:.2f}m" if how == "D" else "H.S 10.00m/s"
        texts.append(f"GPS ({pair[0]:.6f}, {pair[1]:.6f}, 15), {told}, H 9.00m")
    lat, lon, remarks = places(*texts)
    assert lat == pytest.approx(LAT, abs=1e-5) and lon == pytest.approx(LON, abs=1e-3)
    assert any("by the distances" in line for line in remarks.found) and not remarks.assumed


def test_what_a_dialect_alone_tells_is_assumed_aloud() -> None:
    lat, lon, remarks = places("F/2.8, GPS (23.7603, 61.4983, 10), D 2.80m, H 9.00m, H.S 0.00m/s")
    assert (lat, lon) == (LAT, LON) and any("longitude first" in line for line in remarks.assumed)
    lat, lon, remarks = places("GPS(61.4983,23.7603,0.0M) BAROMETER:97.7M")
    assert (lat, lon) == (LAT, LON) and any("latitude first" in line for line in remarks.assumed)
    with pytest.raises(ImportRefusedError, match="which one is the latitude"):
        places("GPS(61.4983,23.7603,16)")


def test_a_row_with_swapped_numbers_is_left_out_and_counted() -> None:
    texts = ["[latitude: 61.4983] [longitude: 23.7603]"] * 9 + ["[latitude: 23.7603] [longitude: 61.4983]"]
    remarks = Remarks()
    found = places_of("a.SRT", [words_of(text) for text in texts], np.arange(10.0), remarks)
    assert np.isfinite(found.lat_deg[:9]).all() and np.isnan(found.lat_deg[9])
    assert remarks.dropped == {"position: 100 km from the others": 1}


def test_the_date_line_parts_no_flight() -> None:
    remarks = Remarks()
    texts = ["[latitude: -17.0] [longitude: 179.9999]", "[latitude: -17.0] [longitude: -179.9999]"]
    found = places_of("a.SRT", [words_of(text) for text in texts], np.arange(2.0), remarks)
    assert np.isfinite(found.lat_deg).all() and not remarks.dropped
