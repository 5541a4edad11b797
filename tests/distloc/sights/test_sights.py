"""From a segment to a direction with its noise, against the numbers of the lens itself."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.sights.sight import Sight, Sights
from distloc.sights.sights import Ray, bisector_px, cuts_of, most_off_px, ray_of, rays_of, sight_of
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors
from tests.support.cube_samples import CAMERA, R_NORTH

LENS = Camera(1920, 1080, 1150.0, 1180.0, 970.0, 530.0, (-0.28, 0.09, 0.001, -0.0005, -0.01))
EXACT = PoseErrors(0.03, 0.01, 0.0, 0.0, 300.0)
MIDDLE_PX = bisector_px(CAMERA, np.array([300.0, 800.0]), np.array([30.0, 40.0]))
NO_CHANGE = np.zeros(2)


def cut_of(ray: Ray, expected_px: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Of one ray (2, 2) and (2,)."""
    along, across_rad = cuts_of([ray], np.full((1, 2), np.nan) if expected_px is None else expected_px[None])
    return along[0], across_rad[0]


def segment(u_px: float, v_px: float, sigma_px: float = 2.0, touches_border: bool = False) -> Detection:
    centre = np.array([u_px, v_px])
    base = centre + np.array([3.0, 20.0])
    return Detection(centre, base, np.eye(2) * 100.0, 1200.0, 30.0, 40.0, sigma_px, touches_border)


def pose(yaw: float = 0.3, pitch: float = -0.2, roll: float = 0.15) -> CameraPose:
    R = R_cam_from_enu(matrix_from_euler(yaw, pitch, roll), np.eye(3))
    return CameraPose(7.0, np.array([10.0, 20.0, 30.0]), R)


def seen(
    one: Detection,
    camera: Camera = CAMERA,
    at: CameraPose | None = None,
    errors: PoseErrors = EXACT,
    pixel_sigma_px: float = 0.0,
    range_m: float = 1000.0,
    size_change_px: FloatArray = NO_CHANGE,
) -> Sight:
    looking_north = CameraPose(0.0, np.zeros(3), R_NORTH)
    ray = ray_of(camera, looking_north if at is None else at, one, "centre")
    return sight_of(ray, errors, pixel_sigma_px, range_m, np.array([one.width_px, one.height_px]) - size_change_px)


@given(st.floats(0.0, 1919.0), st.floats(0.0, 1079.0), st.floats(-3.0, 3.0), st.floats(-1.4, 1.4), st.floats(-1.0, 1.0))
def test_axes_are_right_level_up_and_along_the_ray(u: float, v: float, yaw: float, pitch: float, roll: float) -> None:
    at = pose(yaw, pitch, roll)
    axes = seen(segment(u, v), at=at).axes
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(axes) == pytest.approx(-1.0)  # right x up points backwards
    middle = bisector_px(CAMERA, np.array([u, v]), np.array([30.0, 40.0]))
    ray_cam = np.array([(middle[0] - 959.5) / 1200.0, (middle[1] - 539.5) / 1200.0, 1.0])
    assert axes[2] == pytest.approx(at.R_cam_from_enu.T @ ray_cam / np.linalg.norm(ray_cam), abs=1e-9)
    assert axes[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert axes[1, 2] >= -1e-9


@given(st.floats(-0.7, 0.7), st.floats(0.001, 0.15), st.sampled_from([CAMERA, LENS]))
def test_middle_ray_of_a_round_plume_goes_through_its_axis(bearing_rad: float, half_rad: float, lens: Camera) -> None:
    """The tangents to a circle are as far left as right of its middle, wherever in the image it is."""
    assume(lens is CAMERA or abs(bearing_rad) + half_rad < 0.7)  # a plume that reaches beyond the image has no tangents
    edges = np.array([bearing_rad - half_rad, bearing_rad, bearing_rad + half_rad])
    pixels, _ = lens.project(np.stack([np.sin(edges), np.zeros(3), np.cos(edges)]))
    (left_px, middle_px, right_px), v_px = pixels[0], float(pixels[1, 1])
    centre = np.array([(left_px + right_px) / 2.0, v_px])
    aim = bisector_px(lens, centre, np.array([right_px - left_px, 0.0]))
    assert aim[0] == pytest.approx(middle_px, abs=1.0 if lens is LENS else 1e-6)
    if abs(bearing_rad) > 0.2 and half_rad > 0.05 and lens is CAMERA:
        assert abs(centre[0] - middle_px) > 0.5  # which the pixel midway does not


def test_middle_ray_is_the_middle_pixel_on_the_axis() -> None:
    on_axis = np.array([CAMERA.cx, CAMERA.cy])
    assert bisector_px(CAMERA, on_axis, np.array([400.0, 200.0])) == pytest.approx(on_axis, abs=1e-9)


def test_right_is_right_and_up_is_up() -> None:
    axes = seen(segment(959.5, 539.5)).axes
    assert axes == pytest.approx(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), abs=1e-12)


def test_straight_down_has_axes_too() -> None:
    down = CameraPose(0.0, np.zeros(3), np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]))
    one = seen(segment(959.5, 539.5), at=down)
    assert one.axes @ one.axes.T == pytest.approx(np.eye(3), abs=1e-9)
    assert one.axes[2] == pytest.approx([0.0, 0.0, -1.0])
    assert np.isfinite(one.covariance).all()


@pytest.mark.parametrize("bias_rad", [(1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4), (-5e-5, 8e-5, 3e-5)])
def test_by_nuisance_is_where_the_truth_lies(bias_rad: tuple[float, float, float]) -> None:
    at = pose()
    one = seen(segment(300.0, 800.0), at=at)
    true_R_enu_from_cam = matrix_from_rotation_vector(np.array(bias_rad)).T @ at.R_cam_from_enu.T
    truth = one.axes @ true_R_enu_from_cam @ CAMERA.rays(MIDDLE_PX[:, None])[:, 0]
    assert truth[:2] / truth[2] == pytest.approx(Sights.of([one]).by_nuisance[0, :, :3] @ np.array(bias_rad), abs=3e-8)


@pytest.mark.parametrize("camera", [CAMERA, LENS])
@pytest.mark.parametrize(("u", "v"), [(960.0, 540.0), (200.0, 150.0), (1850.0, 1000.0)])
def test_pixel_noise_through_the_lens_by_sampling(camera: Camera, u: float, v: float) -> None:
    at = pose()
    one = seen(segment(u, v, sigma_px=1.5), camera, at, pixel_sigma_px=2.0)
    noise = np.random.default_rng(0).normal(0.0, 2.5, (2, 100_000))
    rays = one.axes @ at.R_cam_from_enu.T @ camera.rays(np.array([[u], [v]]) + noise)
    sampled = np.cov(rays[:2] / rays[2])
    sigmas = np.sqrt(np.diag(sampled))
    assert one.covariance / np.outer(sigmas, sigmas) == pytest.approx(
        sampled / np.outer(sigmas, sigmas), abs=6 * np.sqrt(2 / 100_000)
    )


def test_at_the_image_centre_a_pixel_is_one_over_f() -> None:
    one = seen(segment(959.5, 539.5, sigma_px=3.0), pixel_sigma_px=4.0)
    assert one.covariance == pytest.approx(np.eye(2) * (5.0 / 1200.0) ** 2, rel=1e-4, abs=1e-12)


@pytest.mark.parametrize(("range_m", "counted_m"), [(500.0, 500.0), (5000.0, 5000.0), (0.0, 1.0)])
def test_position_counts_the_more_the_nearer(range_m: float, counted_m: float) -> None:
    errors = replace(EXACT, position_m=0.5, attitude_white_rad=0.002)
    added = seen(segment(400.0, 300.0), errors=errors, range_m=range_m).covariance
    added = added - seen(segment(400.0, 300.0), range_m=range_m).covariance
    assert added == pytest.approx(np.eye(2) * (0.002**2 + (0.5 / counted_m) ** 2), rel=1e-9, abs=1e-15)


def test_an_edge_that_moved_moves_the_centre_by_half() -> None:
    one = segment(959.5, 539.5, sigma_px=3.0)
    covariance = seen(one, size_change_px=np.array([8.0, 24.0])).covariance
    assert np.sqrt(np.diag(covariance)) * 1200.0 == pytest.approx([5.0, np.hypot(3.0, 12.0)], rel=1e-4)


def beyond_px(one: Detection, expected_px: FloatArray | None) -> FloatArray:
    ray = ray_of(CAMERA, CameraPose(0.0, np.zeros(3), R_NORTH), one, "centre")
    along, across_rad = cut_of(ray, expected_px)
    return np.sqrt(np.diag(along) + np.square(across_rad)) * 1200.0


def test_what_is_cut_is_in_doubt_along_its_own_axis_alone() -> None:
    upright = replace(segment(959.5, 539.5, touches_border=True), is_cut=(False, True))  # 30 x 40 px
    assert beyond_px(replace(upright, touches_border=False), None).tolist() == [0.0, 0.0]
    ragged_px = 0.5 * 30.0
    assert beyond_px(upright, np.array([30.0, 100.0])) == pytest.approx(
        [ragged_px, 30.0], rel=1e-3
    )  # half of what is missing
    assert beyond_px(upright, np.array([30.0, 40.0])) == pytest.approx([ragged_px, 20.0], rel=1e-3)
    assert beyond_px(upright, None) == pytest.approx([ragged_px, 96.0], rel=1e-2)  # a twentieth of the image's width
    leaning = replace(upright, covariance_px2=np.array([[100.0, -50.0], [-50.0, 100.0]]))
    assert beyond_px(leaning, np.array([30.0, 40.0])) == pytest.approx([np.hypot(ragged_px, 10.0), 20.0], rel=1e-3)
    aside = replace(upright, is_cut=(True, False))
    assert beyond_px(aside, np.array([30.0, 40.0])) == pytest.approx([15.0, 0.5 * 40.0], rel=1e-3)


def some_cut() -> list[Detection]:
    """In the middle and off it, upright and leaning; whole, cut along one axis, the other and both."""
    leaning = replace(
        segment(300.0, 700.0, touches_border=True), covariance_px2=np.array([[100.0, -50.0], [-50.0, 60.0]])
    )
    upright = segment(959.5, 539.5, touches_border=True)
    cuts = [(False, False), (True, False), (False, True), (True, True)]
    return [replace(one, is_cut=is_cut) for one in (upright, leaning) for is_cut in cuts]


def test_what_is_cut_of_many_is_that_of_each() -> None:
    rays = rays_of(CAMERA, CameraPose(0.0, np.zeros(3), R_NORTH), some_cut(), "centre")
    expected_px = [None if k % 3 == 0 else np.array([20.0, 30.0]) * k for k in range(len(rays))]
    sizes_px = np.array([np.full(2, np.nan) if one is None else one for one in expected_px])
    for found, alone in zip(zip(*cuts_of(rays, sizes_px), strict=True), map(cut_of, rays, expected_px), strict=True):
        assert found[0] == pytest.approx(alone[0], abs=1e-15) and found[1] == pytest.approx(alone[1], abs=1e-15)


def test_no_middle_is_off_by_more_than_the_most() -> None:
    rays = rays_of(CAMERA, CameraPose(0.0, np.zeros(3), R_NORTH), some_cut(), "centre")
    sizes_px = np.array([[np.nan, np.nan], [10.0, 20.0], [30.0, 40.0], [90.0, 40.0]])
    most_px = most_off_px(rays, sizes_px, 1.0)
    for of_track, size_px in zip(most_px, sizes_px, strict=True):
        for most, ray in zip(of_track, rays, strict=True):
            expected_px = None if np.isnan(size_px).any() else size_px
            along, across_rad = cut_of(ray, expected_px)
            covariance = sight_of(ray, EXACT, 1.0, 1000.0, expected_px).covariance + along + np.diag(across_rad**2)
            sigma_px = np.sqrt(np.linalg.eigvalsh(covariance).max()) / ray.px_rad
            assert sigma_px <= most * (1.0 + 1e-6)
            assert most < 2.0 * np.hypot(sigma_px, 15.0)


def test_a_base_is_cut_only_where_the_border_cuts_it() -> None:
    at = CameraPose(0.0, np.zeros(3), R_NORTH)
    top = replace(segment(959.5, 539.5, touches_border=True), is_cut=(False, True), is_base_cut=(False, False))
    assert not any(one.any() for one in cut_of(ray_of(CAMERA, at, top, "base"), None))
    bottom = replace(top, is_base_cut=(False, True))
    assert cut_of(ray_of(CAMERA, at, bottom, "base"), None)[0][1, 1] > 0.0


def test_a_size_that_the_border_cuts_says_nothing_of_the_middle() -> None:
    top = replace(segment(959.5, 539.5, sigma_px=3.0, touches_border=True), is_cut=(False, True))
    covariance = seen(top, size_change_px=np.array([8.0, 24.0])).covariance
    assert np.sqrt(np.diag(covariance)) * 1200.0 == pytest.approx([5.0, 3.0], rel=1e-4)


def test_aim_at_the_base() -> None:
    one = segment(956.5, 519.5)
    at = CameraPose(3.0, np.array([1.0, 2.0, 3.0]), R_NORTH)
    foot = sight_of(ray_of(CAMERA, at, one, "base"), EXACT, 0.0, 1000.0, np.array([30.0, 40.0]))
    assert foot.axes[2] == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert (foot.stamp_s, foot.position_enu_m.tolist()) == (3.0, [1.0, 2.0, 3.0])
    assert seen(one).axes[2, 2] == pytest.approx(20.0 / 1200.0, rel=1e-3)  # its centre is above the horizon
