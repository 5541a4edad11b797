import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distloc.geometry.camera import Camera

PINHOLE = Camera(640, 480, 500.0, 400.0, 320.0, 240.0)
BROWN = Camera(1920, 1080, 1200.0, 1190.0, 955.0, 545.0, (-0.1, 0.01, 5e-4, -5e-4, 0.0))
FISHEYE = Camera(1920, 1080, 900.0, 900.0, 955.0, 545.0, (0.02, -0.005, 0.001, 0.0), "fisheye")


def column(*values: float) -> np.ndarray:
    return np.array(values, dtype=np.float64)[:, None]


def test_pinhole_projects_to_numbers_worked_out_by_hand() -> None:
    pixels, visible = PINHOLE.project(column(1.0, -0.5, 10.0))
    assert pixels[:, 0] == pytest.approx([370.0, 220.0])  # 320 + 500 * 0.1, 240 - 400 * 0.05
    assert visible.tolist() == [True]


def test_pinhole_ray_by_hand() -> None:
    ray = PINHOLE.rays(column(820.0, 240.0))[:, 0]  # 45 degrees to the right
    assert ray == pytest.approx([np.sqrt(0.5), 0.0, np.sqrt(0.5)])


@pytest.mark.parametrize(("u_px", "is_visible"), [(-0.51, False), (-0.49, True), (639.49, True), (639.51, False)])
def test_image_ends_half_a_pixel_beyond_the_outer_centres(u_px: float, is_visible: bool) -> None:
    _, visible = PINHOLE.project(column((u_px - 320.0) / 500.0, 0.0, 1.0))
    assert visible.tolist() == [is_visible]


@pytest.mark.parametrize("camera", [BROWN, FISHEYE], ids=["brown-conrady", "fisheye"])
@given(u=st.floats(0.0, 1919.0), v=st.floats(0.0, 1079.0), range_m=st.floats(1.0, 3e4))
def test_project_undoes_rays(camera: Camera, u: float, v: float, range_m: float) -> None:
    rays = camera.rays(column(u, v))
    pixels, visible = camera.project(rays * range_m)
    assert visible.all()
    assert pixels[:, 0] == pytest.approx([u, v], abs=1e-3)
    assert np.linalg.norm(rays) == pytest.approx(1.0)


def test_distortion_by_hand() -> None:
    barrel = Camera(1920, 1080, 1000.0, 1000.0, 960.0, 540.0, (-0.1, 0.0, 0.0, 0.0))
    assert barrel.project(column(0.5, 0.0, 1.0))[0][:, 0] == pytest.approx([960.0 + 500.0 * (1 - 0.1 * 0.25), 540.0])
    equidistant = Camera(1920, 1080, 900.0, 900.0, 960.0, 540.0, (0.0, 0.0, 0.0, 0.0), "fisheye")
    assert equidistant.project(column(1.0, 0.0, 1.0))[0][:, 0] == pytest.approx([960.0 + 900.0 * np.pi / 4, 540.0])


@pytest.mark.parametrize("camera", [PINHOLE, BROWN, FISHEYE], ids=["pinhole", "brown-conrady", "fisheye"])
@pytest.mark.parametrize("point", [(0.0, 0.0, -10.0), (0.1, 0.1, 0.0), (30.0, 20.0, 1.0), (-1e6, 0.0, 1.0)])
def test_behind_or_far_outside_is_not_visible(camera: Camera, point: tuple[float, float, float]) -> None:
    assert camera.project(column(*point))[1].tolist() == [False]


def test_point_that_the_polynomial_folds_back_into_the_image_is_not_visible() -> None:
    folding = Camera(1920, 1080, 1200.0, 1200.0, 960.0, 540.0, (-0.1, 0.0, 0.0, 0.0))
    folded = np.sqrt(10.0)  # r (1 - 0.1 r^2) = 0: the image's middle
    _, visible = folding.project(np.array([[folded, 0.5], [0.0, 0.0], [1.0, 1.0]]))
    assert visible.tolist() == [False, True]


@pytest.mark.parametrize("camera", [PINHOLE, BROWN, FISHEYE], ids=["pinhole", "brown-conrady", "fisheye"])
def test_no_points_give_no_pixels(camera: Camera) -> None:
    pixels, visible = camera.project(np.zeros((3, 0)))
    assert pixels.shape == (2, 0)
    assert visible.shape == (0,)
    assert camera.rays(np.zeros((2, 0))).shape == (3, 0)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"width": 0}, "width"),
        ({"height": -1}, "height"),
        ({"fx": 0.0}, "fx"),
        ({"fy": float("nan")}, "fy"),
        ({"cx": float("inf")}, "cx"),
        ({"distortion": (0.1, 0.2, 0.3)}, "distortion"),
        ({"distortion": (0.1, 0.2, 0.3, float("nan"))}, "distortion"),
        ({"model": "fisheye"}, "fisheye"),
    ],
)
def test_impossible_values_raise(changes: dict, named: str) -> None:
    values = {"width": 640, "height": 480, "fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0}
    with pytest.raises(ValueError, match=named):
        Camera(**{**values, **changes})
