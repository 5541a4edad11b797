import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.publish.exchange.rings import cut_at_antimeridian, ellipse_ring
from tests.support.ground_samples import ellipse
from tests.support.shared_fires import WGS84, area_m2


@given(
    lat_deg=st.floats(-80.0, 80.0),
    lon_deg=st.floats(-180.0, 180.0),
    major_m=st.floats(2.0, 20_000.0),
    share=st.floats(0.05, 1.0),
    azimuth_deg=st.floats(0.0, 180.0),
    points=st.sampled_from([20, 72]),
)
def test_a_ring_has_the_ellipses_area_and_runs_counterclockwise(
    lat_deg: float, lon_deg: float, major_m: float, share: float, azimuth_deg: float, points: int
) -> None:
    ring = ellipse_ring(lat_deg, lon_deg, ellipse(major_m, max(1.0, share * major_m), azimuth_deg), points)
    assert ring is not None and ring[0] == ring[-1] and len(ring) == points + 1
    parts = cut_at_antimeridian(ring)
    assert all(-180.0 <= lon <= 180.0 for part in parts for lon, _ in part)
    assert all(part[0] == part[-1] for part in parts)
    expected_m2 = math.pi * major_m * max(1.0, share * major_m)
    assert sum(map(area_m2, parts)) == pytest.approx(expected_m2, rel=0.02)
    assert all(area_m2(part) > 0.0 for part in parts)


def test_the_long_axis_lies_along_the_azimuth() -> None:
    ring = ellipse_ring(47.0, 8.0, ellipse(1000.0, 100.0, 30.0))
    assert ring is not None
    away = [WGS84.inv(8.0, 47.0, lon, lat) for lon, lat in ring]
    azimuth_deg, _, distance_m = max(away, key=lambda one: one[2])
    assert azimuth_deg % 180.0 == pytest.approx(30.0, abs=0.1) and distance_m == pytest.approx(1000.0, rel=0.005)


def test_a_ring_over_the_antimeridian_is_two_that_touch_it() -> None:
    for lon_deg in (179.995, -179.995):
        ring = ellipse_ring(-17.0, lon_deg, ellipse(1500.0, 800.0, 90.0))
        assert ring is not None
        west, east = cut_at_antimeridian(ring)
        assert max(lon for lon, _ in west) == 180.0 and min(lon for lon, _ in west) > 179.9
        assert min(lon for lon, _ in east) == -180.0 and max(lon for lon, _ in east) < -179.9
        assert area_m2(west) + area_m2(east) == pytest.approx(np.pi * 1500.0 * 800.0, rel=0.005)


@pytest.mark.parametrize(
    "axes",
    [
        *((None, 1.0, 0.0), (1.0, None, 0.0), (1.0, 1.0, None), (0.0, 0.0, 0.0), (-5.0, -9.0, 0.0), (1.0, 2.0, 0.0)),
        *((1e7, 10.0, 0.0), (10.0, 1.0, 1e9), (float("nan"), 1.0, 0.0)),
    ],
)
def test_what_is_no_ellipse_has_no_ring(axes: tuple[float | None, float | None, float | None]) -> None:
    assert ellipse_ring(47.0, 8.0, ellipse(*axes)) is None


def test_no_ring_about_a_pole() -> None:
    assert ellipse_ring(89.9, 8.0, ellipse(20_000.0, 20_000.0, 0.0)) is None
