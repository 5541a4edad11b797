"""Places to which no craft can have flown are left out, from whatever source; and the step of the digits is told."""

import numpy as np
import pytest

from distloc.geometry.rotations import quaternion_from_euler
from service.recordings.importers.assumptions import Assumed, completed
from service.recordings.importers.flight import Attitudes, ImportedFlight, Positions, Remarks, unknown
from service.recordings.importers.rows import attitudes_of

COUNT = 60


def flight(wild: dict[int, tuple[float, float]], digits: int = 8, step_s: float = 0.5) -> ImportedFlight:
    """15 m/s to the north."""
    time_s = np.arange(COUNT) * step_s
    lat, lon = 47.1 + time_s * 15.0 / 111_195.0, np.full(COUNT, 8.2123456)
    for at, (lat_deg, lon_deg) in wild.items():
        lat[at], lon[at] = lat_deg, lon_deg
    lat, lon = np.round(lat, digits), np.round(lon, digits)
    positions = Positions(time_s, lat, lon, np.full(COUNT, 500.0), *(unknown(COUNT),) * 2, unknown(COUNT, 3))
    q = np.repeat([[1.0, 0.0, 0.0, 0.0]], COUNT, axis=0)
    return ImportedFlight("a", 0.0, positions=positions, craft=Attitudes(time_s, q, unknown(COUNT, 3)))


@pytest.mark.parametrize(
    "wild",
    [
        {20: (-47.1, 8.2)},
        {0: (47.3, 8.2)},
        {COUNT - 1: (47.1, 8.5)},
        {9: (47.11, 8.22), 10: (8.2, 47.1), 40: (47.1, 8.3)},
    ],
)
@pytest.mark.parametrize("step_s", [0.1, 0.5, 2.0])
def test_a_place_that_was_not_flown_to_is_left_out_and_counted(
    wild: dict[int, tuple[float, float]], step_s: float
) -> None:
    done = completed(flight(wild, step_s=step_s), Assumed())
    assert done.positions is not None and len(done.positions.time_s) == COUNT - len(wild)
    assert np.abs(done.positions.lon_deg - 8.2123456).max() < 1e-6
    assert done.remarks.dropped == {"position: the craft cannot have flown there and back": len(wild)}


def test_a_flight_after_a_long_gap_is_kept() -> None:
    one = flight({})
    assert one.positions is not None
    time_s = one.positions.time_s.copy()
    lat = one.positions.lat_deg.copy()
    time_s[30:] += 600.0
    lat[30:] += 0.05  # 5.6 km in ten minutes
    moved = Positions(time_s, lat, *(getattr(one.positions, name) for name in list(Positions.__dataclass_fields__)[2:]))
    done = completed(ImportedFlight("a", 0.0, positions=moved, craft=one.craft), Assumed())
    assert done.positions is not None and len(done.positions.time_s) == COUNT and not done.remarks.dropped


@pytest.mark.parametrize(("digits", "step_m"), [(4, 11.1), (5, 1.11), (7, 0.0)])
def test_the_step_of_the_digits_is_told(digits: int, step_m: float) -> None:
    done = completed(flight({}, digits), Assumed())
    assert done.position_step_m == pytest.approx(step_m, rel=0.01)
    assert any("to one side" in line for line in done.remarks.assumed) == (step_m > 0.5)


def test_an_attitude_that_a_flipped_bit_made_is_left_out() -> None:
    time_s = np.arange(0.0, 10.0, 0.02)
    q = quaternion_from_euler(0.3 * np.sin(time_s), 0.1 * np.cos(time_s), 0.0 * time_s).T
    q[[100, 300, 301]] = quaternion_from_euler(2.0, -1.0, 0.5)
    remarks = Remarks()
    found = attitudes_of(time_s, q, remarks)
    assert found is not None and len(found.time_s) == len(time_s) - 3
    assert remarks.dropped == {"attitude: nothing turns there and back so fast": 3}
