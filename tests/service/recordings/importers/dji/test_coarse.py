"""Places in steps of 11 m: the path through them is nearer to the true one than they are."""

import math

import numpy as np
import pytest

from service.recordings.importers.dji.coarse import smoothed

METRES = 111_195.0


@pytest.mark.parametrize(("speed_mps", "turn_dps"), [(3.0, 0.0), (8.0, 2.0), (15.0, 4.0)])
def test_a_smooth_path_halves_the_steps_errors(speed_mps: float, turn_dps: float) -> None:
    t = np.arange(0.0, 120.0, 1.0)
    course = np.radians(30.0 + turn_dps * t)
    north = np.concatenate([[0.0], np.cumsum(speed_mps * np.cos(course))[:-1]])
    east = np.concatenate([[0.0], np.cumsum(speed_mps * np.sin(course))[:-1]])
    lat, lon = 47.0 + north / METRES, 8.0 + east / METRES / math.cos(math.radians(47.0))
    told_lat, told_lon = np.round(lat, 4), np.round(lon, 4)
    kept, smooth_lat, smooth_lon, velocity = smoothed(t, told_lat, told_lon)
    np.testing.assert_array_equal(kept, np.arange(120))
    inner = slice(5, -5)

    def rms_m(found_lat: np.ndarray, found_lon: np.ndarray) -> float:  # type: ignore[type-arg]
        off = np.stack([(found_lat - lat) * METRES, (found_lon - lon) * METRES * math.cos(math.radians(47.0))])[
            :, inner
        ]
        return float(np.sqrt(np.mean(off**2)))

    assert rms_m(smooth_lat, smooth_lon) < 0.65 * rms_m(told_lat, told_lon)
    off = velocity[inner] - speed_mps * np.stack([np.cos(course), np.sin(course)], axis=1)[inner]
    assert np.sqrt(np.mean(off**2)) < 1.2  # of differences of the steps: 3 to 5


def test_over_the_date_line_and_beside_cues_without_a_place() -> None:
    t = np.arange(0.0, 20.0, 1.0)
    lon = (179.9990 + 1e-4 * t + 180.0) % 360.0 - 180.0
    lat = np.full(20, -17.0)
    lat[3], lon[3] = np.nan, np.nan
    lat[4], lon[4] = 0.0, 0.0
    kept, smooth_lat, smooth_lon, velocity = smoothed(t, lat, lon)
    assert 3 not in kept and 4 not in kept and len(kept) == 18
    np.testing.assert_allclose(smooth_lat, -17.0, atol=1e-9)
    np.testing.assert_allclose((smooth_lon - lon[kept] + 180.0) % 360.0 - 180.0, 0.0, atol=1e-7)
    np.testing.assert_allclose(velocity[2:, 1], 1e-4 * METRES * math.cos(math.radians(17.0)), rtol=1e-3)


def test_a_few_cues_are_left_as_they_are() -> None:
    kept, lat, lon, velocity = smoothed(np.arange(3.0), np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    np.testing.assert_array_equal(lat, [1.0, 2.0, 3.0])
    assert len(kept) == 3 and len(lon) == 3 and np.isnan(velocity).all()
