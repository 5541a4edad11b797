"""Speeds by the places, on both hemispheres and over the date line."""

import numpy as np
import pytest

from service.recordings.importers.assumptions import EARTH_M, course_attitudes, derived_velocity_mps
from service.recordings.importers.flight import Positions, unknown


@pytest.mark.parametrize("start", [(47.4, 8.5), (33.1, -117.3), (-35.3, 149.1), (10.0, 179.9999)])
def test_a_straight_flight_has_its_own_speed_anywhere(start: tuple[float, float]) -> None:
    time_s = np.arange(0.0, 20.0, 0.5)
    lat = start[0] + np.degrees(6.0 * time_s / EARTH_M)
    lon = start[1] + np.degrees(8.0 * time_s / EARTH_M / np.cos(np.radians(start[0])))
    lon = (lon + 180.0) % 360.0 - 180.0
    flat = np.full(len(time_s), 500.0) - 0.5 * time_s
    positions = Positions(time_s, lat, lon, flat, flat, flat, unknown(len(time_s), 3))
    velocity = derived_velocity_mps(positions)
    assert velocity == pytest.approx(np.tile([6.0, 8.0, 0.5], (len(time_s), 1)), abs=0.01)
    course = course_attitudes(
        Positions(time_s, lat, lon, flat, flat, flat, velocity),
    )
    assert course is not None
    yaw_deg = np.degrees(2.0 * np.arctan2(course.q_ned_from_body[:, 3], course.q_ned_from_body[:, 0]))
    assert yaw_deg == pytest.approx(np.degrees(np.arctan2(8.0, 6.0)), abs=0.1)
