import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from distloc.geometry.geodesy import LocalFrame

GEOD = Geod(ellps="WGS84")
FRAME = LocalFrame(47.0, 8.5, 0.0)


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
