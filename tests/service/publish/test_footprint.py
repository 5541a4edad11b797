"""What the camera sees of the ground at home's altitude, by hand and by the filter's camera."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from distloc.geometry.camera import Camera
from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.types import CameraPose, FloatArray
from service.publish.footprint import Footprint, SeenGround

CAMERA = Camera(1280, 720, 900.0, 900.0, 639.5, 359.5)
FRAME = LocalFrame(47.4, 8.6, 520.0)  # the first position heard: in the air, 120 m over home
HOME_M = 400.0


def looking(pitch_deg: float, roll_deg: float = 0.0, up_m: float = 0.0, yaw_deg: float = 0.0) -> CameraPose:
    angles = np.radians([yaw_deg, pitch_deg, roll_deg])
    return CameraPose(0.0, np.array([0.0, 0.0, up_m]), R_cam_from_enu(matrix_from_euler(*angles), np.eye(3)))


def seen(pose: CameraPose, camera: Camera = CAMERA) -> SeenGround:
    return Footprint(camera).seen(pose, FRAME, HOME_M)


def corners_en_m(ground: SeenGround) -> FloatArray:
    """(2, N) of the polygon, as seen from the origin."""
    return np.array([FRAME.enu_from_geodetic(lat, lon, HOME_M)[:2] for lon, lat in ground.corners]).T


def area_m2(corners_m: FloatArray) -> float:
    x, y = corners_m
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_the_centre_is_where_the_optical_axis_meets_homes_altitude() -> None:
    ground = seen(looking(-5.0))
    assert ground.centre is not None and ground.centre.alt_msl_m == HOME_M
    east_m, north_m, up_m = FRAME.enu_from_geodetic(ground.centre.lat_deg, ground.centre.lon_deg, HOME_M)
    level_m = 120.0 / math.tan(math.radians(5.0))  # 1372 m; there the earth, less light's bending, is 0.13 m lower
    fallen_m = 0.87 * level_m**2 / (2.0 * 6_371_000.0) / math.tan(math.radians(5.0))
    assert fallen_m > 1.4 and (east_m, north_m) == pytest.approx((0.0, level_m + fallen_m), abs=0.1)
    assert up_m == pytest.approx(-120.0, abs=0.2)


def test_straight_down_it_is_the_image_on_the_ground() -> None:
    corners = corners_en_m(seen(looking(-90.0)))
    assert np.abs(corners).max(axis=1) == pytest.approx([120.0 * 639.5 / 900.0, 120.0 * 359.5 / 900.0], rel=1e-3)
    assert corners.shape == (2, 4)


def test_a_camera_that_sees_the_horizon_gets_the_ground_below_it() -> None:
    corners = corners_en_m(seen(looking(-5.0)))
    ranges_m = np.hypot(*corners)
    side, below, sine, cosine = 639.5 / 900.0, 359.5 / 900.0, math.sin(math.radians(5.0)), math.cos(math.radians(5.0))
    near_m = 120.0 * math.hypot(side, cosine - sine * below) / (sine + cosine * below)
    assert ranges_m.min() == pytest.approx(near_m, rel=1e-3)
    assert (ranges_m > 29_900.0).sum() == 7 and ranges_m.max() < 30_100.0
    half_deg = np.degrees(np.arctan2(np.abs(corners[0]), corners[1])).max()
    assert half_deg == pytest.approx(math.degrees(math.atan(639.5 / 900.0)), abs=2.0)
    assert abs(area_m2(corners)) == pytest.approx(math.radians(35.4) * 30_000.0**2, rel=0.03)


def test_low_down_the_horizon_is_nearer() -> None:
    ranges_m = np.hypot(*corners_en_m(seen(looking(-5.0, up_m=-110.0))))
    assert ranges_m.max() == pytest.approx(math.sqrt(2.0 * 6_371_000.0 / 0.87 * 10.0), rel=1e-3)


@pytest.mark.parametrize(
    "pose", [looking(40.0), looking(-30.0, up_m=-120.0), looking(-30.0, up_m=-500.0), looking(0.0, up_m=float("nan"))]
)
def test_no_ground_in_view_and_no_height_over_it_give_none(pose: CameraPose) -> None:
    assert seen(pose) == SeenGround()


def test_an_unknown_home_gives_none() -> None:
    assert Footprint(CAMERA).seen(looking(-30.0), FRAME, None) == SeenGround()


def test_beyond_the_ground_s_end_there_is_a_polygon_but_no_centre() -> None:
    ground = seen(looking(-0.1))
    assert ground.centre is None and len(ground.corners) == 9


@settings(deadline=None, max_examples=60)
@given(st.floats(-90, 20), st.floats(-180, 180), st.floats(-180, 180), st.sampled_from([(), (-0.2, 0.05, 0.0, 0.0)]))
def test_what_lies_in_the_polygon_is_in_the_image(
    pitch_deg: float, roll_deg: float, yaw_deg: float, distortion: tuple[float, ...]
) -> None:
    camera = replace(CAMERA, distortion=distortion)
    pose = looking(pitch_deg, roll_deg, yaw_deg=yaw_deg)
    ground = seen(pose, camera)
    if not ground.corners:
        return
    corners = corners_en_m(ground)
    assert np.hypot(*corners).max() < 30_100.0
    # a simple polygon of one sense whose corners the camera sees, but for a border's width
    points_enu = np.vstack([corners, np.full(corners.shape[1], -120.0)])
    pixels, _ = camera.project(pose.R_cam_from_enu @ points_enu)
    assert np.isfinite(pixels).all()
    assert (
        (pixels > -30.0).all() and (pixels[0] < camera.width + 30.0).all() and (pixels[1] < camera.height + 30.0).all()
    )
