import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod, Transformer

from distloc.geometry.geodesy import LocalFrame, ecef_from_geodetic, geodetic_from_ecef

GEOD = Geod(ellps="WGS84")
FRAME = LocalFrame(47.0, 8.5, 0.0)
TO_ECEF = Transformer.from_crs("EPSG:4979", "EPSG:4978")


@pytest.mark.parametrize("azimuth_deg", [0.0, 60.0, 135.0, 270.0])
def test_ten_kilometres_agree_with_the_geodesic(azimuth_deg: float) -> None:
    lon_deg, lat_deg, _ = GEOD.fwd(8.5, 47.0, azimuth_deg, 10_000.0)
    east, north, up = FRAME.enu_from_geodetic(lat_deg, lon_deg, 0.0)
    assert np.hypot(east, north) == pytest.approx(10_000.0, abs=0.01)  # arc to tangent plane: d^3 / 6R^2 = 4 mm
    turned_deg = (np.degrees(np.arctan2(east, north)) - azimuth_deg + 180.0) % 360.0 - 180.0
    assert turned_deg == pytest.approx(0.0, abs=1e-4)
    assert up == pytest.approx(-(10_000.0**2) / (2 * 6.378e6), abs=0.05)  # the earth curves away: 7.84 m


@settings(deadline=None)
@given(st.floats(-89.0, 89.0), st.floats(-180.0, 180.0), st.tuples(*[st.floats(-3e4, 3e4)] * 2, st.floats(-500.0, 5e3)))
def test_round_trip(lat_deg: float, lon_deg: float, enu: tuple[float, float, float]) -> None:
    frame = LocalFrame(lat_deg, lon_deg, 300.0)
    back = frame.enu_from_geodetic(*frame.geodetic_from_enu(np.array(enu)))
    assert back == pytest.approx(np.array(enu), abs=1e-4)


def test_origin_and_straight_up() -> None:
    frame = LocalFrame(-33.0, 151.0, 40.0)
    assert frame.enu_from_geodetic(-33.0, 151.0, 40.0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    assert frame.enu_from_geodetic(-33.0, 151.0, 140.0) == pytest.approx([0.0, 0.0, 100.0], abs=1e-6)


@pytest.mark.parametrize("origin", [(91.0, 0.0, 0.0), (0.0, 181.0, 0.0), (np.nan, 0.0, 0.0), (0.0, 0.0, np.inf)])
def test_origin_off_the_earth_raises(origin: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="origin"):
        LocalFrame(*origin)


@pytest.mark.parametrize("lat_deg", [-90.0, -89.9999, -33.3, 0.0, 1e-9, 45.0, 71.2, 90.0])
@pytest.mark.parametrize("height_m", [-430.0, 0.0, 120.0, 8_848.0, 40_000.0])
def test_both_ways_agree_with_proj(lat_deg: float, height_m: float) -> None:
    for lon_deg in (-180.0, -71.3, 0.0, 8.5, 179.9):
        ecef_m = ecef_from_geodetic(lat_deg, lon_deg, height_m)
        assert ecef_m == pytest.approx(np.array(TO_ECEF.transform(lat_deg, lon_deg, height_m)), abs=1e-8)
        back = geodetic_from_ecef(ecef_m)
        assert back[0] == pytest.approx(lat_deg, abs=1e-12) and back[2] == pytest.approx(height_m, abs=1e-8)
        if abs(lat_deg) < 90.0:
            assert (back[1] - lon_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-9)
