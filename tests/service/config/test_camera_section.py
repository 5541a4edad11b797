"""The intrinsics of [camera]: all of a calibration, or none and the lens' view."""

from typing import Any

import pytest

from service.config.sections import CameraConfig, ConfigError

ALL: dict[str, Any] = {"fx": 900.0, "fy": 900.0, "cx": 640.0, "cy": 360.0}
HD: dict[str, Any] = {"width": 1280, "height": 720}


def test_a_calibration_is_taken_as_it_is() -> None:
    camera = CameraConfig(**HD, **ALL).camera()
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (1280, 720, 900, 900, 640, 360)


@pytest.mark.parametrize("size", [{}, {"width": 1920}, {"width": 1920, "height": 1080}])
def test_nothing_at_all_is_full_hd(size: dict[str, Any]) -> None:
    camera = CameraConfig(**size).camera()
    assert (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy) == (
        1920,
        1080,
        1200,
        1200,
        960,
        540,
    )


def test_a_view_has_square_pixels_about_the_middle() -> None:
    camera = CameraConfig(**HD, hfov_deg=90.0).camera()
    assert (camera.fx, camera.fy) == pytest.approx((640.0, 640.0))
    assert (camera.cx, camera.cy) == (639.5, 359.5)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        (HD, "camera.width, camera.height are 1280 x 720 without fx, fy, cx, cy: give all four"),
        ({"width": 1280}, "are 1280 x 1080 without fx"),
        ({"fx": 900.0}, "camera has fx and lacks fy, cx, cy: give all four"),
        ({**HD, "fx": 900.0, "fy": 900.0}, "camera has fx, fy and lacks cx, cy"),
        ({**HD, "cx": 640.0, "cy": 360.0}, "camera has cx, cy and lacks fx, fy"),
        ({**HD, **ALL, "hfov_deg": 70.0}, "camera.hfov_deg is 70 beside camera.fx: give one of them"),
        ({**HD, "hfov_deg": 70.0, "fx": 900.0}, "camera has fx and lacks"),
        ({"distortion": (0.1, 0.0, 0.0, 0.0)}, "without fx, fy, cx, cy: they come from one calibration"),
        ({"model": "fisheye", "hfov_deg": 120.0}, "'fisheye' without fx"),
        ({**HD, **ALL, "cx": 1300.0}, "camera.cx, camera.cy are 1300, 360: the principal point must lie in the image"),
        ({**HD, **ALL, "cy": -1.0}, "are 640, -1: the principal point"),
        ({**ALL, "width": 640, "height": 360, "cy": 540.0}, "of 640 x 360; was it calibrated at another size?"),
        ({**HD, **ALL, "fy": 90.0}, "camera.fx, camera.fy are 900, 90: they must be nearly alike"),
        ({**HD, **ALL, "fx": 2e6, "fy": 2e6}, "camera.fx is 2e+06: at a width of 1280 that is a view of"),
        ({**HD, **ALL, "fx": 0.9, "fy": 0.9}, "camera.fx is 0.9: at a width of 1280 that is a view of 180 degrees"),
    ],
)
def test_what_makes_no_camera_is_one_line(keys: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        CameraConfig(**keys).camera()
    assert says in str(caught.value) and "\n" not in str(caught.value)
