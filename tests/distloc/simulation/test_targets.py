import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.plume import Plume
from distloc.simulation.targets import Box, DriftingPlume, Target, mast
from distloc.types import CameraPose, FloatArray
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, cube_mask, empty_mask, pose_at

BASE = np.array([100.0, 800.0, -20.0])
STAMPS_S = (0.0, 60.0, 150.0, 300.0)


def drawn(target: Target, pose: CameraPose, camera: Camera = CAMERA) -> NDArray[np.uint8]:
    mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
    target.draw(mask, camera, pose)
    return mask


def bounds(mask: NDArray[np.uint8]) -> tuple[int, int, int, int]:
    rows, columns = np.nonzero(mask)
    return int(columns.min()), int(rows.min()), int(columns.max()), int(rows.max())


def pose_of(stamp_s: float) -> CameraPose:
    return CameraPose(stamp_s, np.zeros(3), R_NORTH)


def plume(width_m: float = 60.0) -> Plume:
    return Plume(BASE, 120.0, width_m, np.array([4.0, 0.0, 0.0]), growth_s=300.0, start_share=0.4)


def test_corners_of_a_box() -> None:
    corners = Box(np.array([1.0, 2.0, 3.0]), (2.0, 4.0, 6.0)).corners_enu_m
    assert corners.shape == (3, 8)
    expected = {(e, n, u) for e in (0.0, 2.0) for n in (0.0, 4.0) for u in (0.0, 6.0)}
    assert {tuple(corner) for corner in corners.T} == expected


def test_the_papers_cube_covers_the_pixels_worked_out_by_hand() -> None:
    # u = 959.5 + 1200 x / z, v = 539.5 + 1200 y / z: x 450..550, y -250..-150, z 1950..2050
    # 959.5 + 263.41 = 1222.91, 959.5 + 338.46 = 1297.96; 539.5 - 153.85 = 385.65, 539.5 - 87.80 = 451.70
    mask = drawn(Box(CUBE_ENU_M), pose_at(0.0))
    assert bounds(mask) == (1223, 386, 1298, 452)
    assert set(np.unique(mask)) == {0, 255}
    near_face_px = (1200.0 * 100.0 / 1950.0) ** 2  # 61.5 px a side; the top and left of the hull are more
    assert near_face_px < np.count_nonzero(mask) < 76 * 67
    assert np.array_equal(mask, cube_mask(pose_at(0.0)))


@pytest.mark.parametrize(("shift_px", "left", "right"), [(0.0, 31, 71), (0.4, 31, 71), (0.6, 32, 72), (-0.6, 30, 70)])
def test_corners_are_rounded_to_whole_pixels(shift_px: float, left: int, right: int) -> None:
    camera = Camera(100, 100, 100.0, 100.0, 51.0 + shift_px, 50.0)
    thin = Box(np.array([0.0, 10.0, 0.0]), (4.0, 1e-6, 2.0))  # 20 px left and right of the middle, 10 above and below
    mask = drawn(thin, pose_of(0.0), camera)
    assert bounds(mask) == (left, 40, right, 60)
    assert np.count_nonzero(mask) == 41 * 21


def test_draw_adds_to_what_is_there() -> None:
    mask = empty_mask()
    mask[1000, 3] = 255
    Box(CUBE_ENU_M).draw(mask, CAMERA, pose_at(0.0))
    assert mask[1000, 3] == 255 and np.count_nonzero(mask) == np.count_nonzero(cube_mask(pose_at(0.0))) + 1


@pytest.mark.parametrize(
    "place",
    [(0.0, -500.0, 0.0), (0.0, 49.0, 0.0), (0.0, 0.0, 0.0), (40.0, 50.0, 0.0)],
    ids=["behind", "a face behind", "around the camera", "a face at the camera"],
)
def test_a_corner_behind_the_camera_draws_nothing(place: tuple[float, float, float]) -> None:
    box = Box(np.array(place))
    assert box.corners_px(CAMERA, pose_of(0.0)) is None
    assert not drawn(box, pose_of(0.0)).any()


@pytest.mark.parametrize("east_m", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("up_m", [-1.0, 0.0, 1.0])
def test_a_target_outside_the_image_draws_nothing(east_m: float, up_m: float) -> None:
    place = np.array([2500.0 * east_m, 2000.0, 1500.0 * up_m])
    is_outside = (east_m, up_m) != (0.0, 0.0)
    for target in (Box(place), DriftingPlume(Plume(place, 120.0, 60.0, np.zeros(3)))):
        assert drawn(target, pose_of(0.0)).any() != is_outside


def test_a_target_across_the_border_is_cut() -> None:
    mask = drawn(Box(np.array([1600.0, 2000.0, 0.0])), pose_of(0.0))  # 1600 m right is 0.5 px beyond the last column
    left, _, right, _ = bounds(mask)
    assert right == 1919 and 1866 <= left <= 1868  # 959.5 + 1200 * 1550 / 2050 = 1866.8


def test_inside_a_box_has_its_faces() -> None:
    box = Box(np.array([10.0, 20.0, 30.0]), (2.0, 4.0, 6.0))
    within = np.array([[10, 20, 30], [11, 20, 30], [9, 18, 27], [11, 22, 33], [10, 20, 33]], dtype=np.float64).T
    beyond = np.array([[11.01, 20, 30], [10, 22.01, 30], [10, 20, 26.99], [30, 10, 20]], dtype=np.float64).T
    assert box.is_inside(within, 0.0).tolist() == [True] * 5
    assert box.is_inside(beyond, 0.0).tolist() == [False] * 4
    assert box.is_inside(np.zeros((3, 0)), 0.0).shape == (0,)


@pytest.mark.parametrize("size", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, np.nan)])
def test_a_box_without_sides_raises(size: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="sides"):
        Box(np.zeros(3), size)


def test_a_mast_stands_on_its_base() -> None:
    corners = mast(np.array([5.0, 700.0, 10.0])).corners_enu_m
    assert corners.min(axis=1) == pytest.approx([3.5, 698.5, 10.0])
    assert corners.max(axis=1) == pytest.approx([6.5, 701.5, 70.0])
    assert mast(np.zeros(3)).centre_enu_m(9.0) == pytest.approx([0.0, 0.0, 30.0])


def test_a_plumes_centre_drifts_downwind_and_its_base_does_not() -> None:
    target = DriftingPlume(plume())
    centres = np.array([target.centre_enu_m(stamp_s) for stamp_s in STAMPS_S])
    assert (np.diff(centres[:, 0]) > 2.0).all() and (np.diff(centres[:, 2]) > 2.0).all()
    assert centres[:, 1] == pytest.approx(BASE[1])
    assert centres[-1] - BASE == pytest.approx((centres[0] - BASE) / 0.4)  # it grows from 0.4 of its size to all
    assert target.centre_enu_m(900.0) == pytest.approx(centres[-1])
    for stamp_s in STAMPS_S:
        assert target.base_enu_m(stamp_s) == pytest.approx(BASE)


def test_a_grown_plumes_centre_against_an_integral() -> None:
    # reach 1 - 0.3 * 60 / 120 = 0.85; the mean over s of (48 (0.85 s)^1.5, 120 * 0.85 s) weighted by 0.3 + 0.7 s^0.5
    # int w = 0.3 + 0.7 / 1.5; int w s = 0.15 + 0.28; int w s^1.5 = 0.12 + 0.7 / 3
    weight = 0.3 + 0.7 / 1.5
    east_m, up_m = 48.0 * 0.85**1.5 * (0.12 + 0.7 / 3.0) / weight, 102.0 * 0.43 / weight
    centre = DriftingPlume(plume()).centre_enu_m(300.0)
    assert centre - BASE == pytest.approx([east_m, 0.0, up_m], abs=0.3)


@pytest.mark.parametrize("stamp_s", STAMPS_S)
def test_a_plumes_lowest_pixels_are_at_its_base(stamp_s: float) -> None:
    mask = drawn(DriftingPlume(plume()), pose_of(stamp_s))
    size = 0.4 + 0.6 * stamp_s / 300.0
    u, v = 959.5 + 1200.0 * 100.0 / 800.0, 539.5 + 1200.0 * 20.0 / 800.0
    radius_px = 1200.0 * size * 0.15 * 60.0 / 800.0  # 0.3 of the half-width
    rows, columns = np.nonzero(mask)
    assert v < rows.max() <= v + radius_px + 1.0
    assert abs(columns[rows == rows.max()].mean() - u) < radius_px


@pytest.mark.parametrize("stamp_s", STAMPS_S)
def test_inside_a_plume(stamp_s: float) -> None:
    target = DriftingPlume(plume())
    size = 0.4 + 0.6 * stamp_s / 300.0
    inside = np.stack([target.centre_enu_m(stamp_s), BASE, BASE + np.array([8.9 * size, 0.0, 0.0])], axis=1)
    assert target.is_inside(inside, stamp_s).tolist() == [True] * 3
    far = [[500.0, 0, 0], [0, 500, 0], [0, 0, 500], [0, 0, -1], [9.2 * size, 0, 0], [0, 0, 103.0 * size]]
    assert not target.is_inside(BASE[:, None] + np.array(far).T, stamp_s).any()


def inside_points(target: DriftingPlume, stamp_s: float) -> FloatArray:
    rng = np.random.default_rng(5)
    size = 0.4 + 0.6 * stamp_s / 300.0
    points = BASE[:, None] + size * rng.uniform([-40.0, -40.0, -10.0], [80.0, 40.0, 130.0], (60_000, 3)).T
    return points[:, target.is_inside(points, stamp_s)]


@pytest.mark.parametrize("stamp_s", [0.0, 150.0, 300.0])
def test_points_inside_a_plume_are_in_its_mask_and_fill_it(stamp_s: float) -> None:
    target = DriftingPlume(plume())
    mask = drawn(target, pose_of(stamp_s))
    points = inside_points(target, stamp_s)
    u, v = np.rint(np.stack([959.5 + 1200.0 * points[0] / points[1], 539.5 - 1200.0 * points[2] / points[1]])).astype(
        int
    )
    assert 3000 < points.shape[1] < 30_000
    assert np.mean(mask[v, u] > 0) >= 0.97
    left, top, right, bottom = bounds(mask)
    # the outline's round ends, 0.3 of the half-width below and the half-width above, hold no inside points
    size = 0.4 + 0.6 * stamp_s / 300.0
    assert abs(u.min() - left) <= 4 and 0 <= right - u.max() <= 1200.0 * size * 30.0 / 800.0
    assert 0 <= bottom - v.max() <= 1200.0 * size * 9.0 / 800.0 + 2
    assert 0 <= v.min() - top <= 1200.0 * size * 30.0 / 800.0 + 4


def test_a_plumes_mask_against_chords_painted_row_by_row() -> None:
    # grown: 102 m from end to end, 48 (0.85 s)^1.5 m of lean, 30 (0.3 + 0.7 s^0.5) m of radius; 1.5 px a metre
    v, u = np.mgrid[300:700, 1000:1400]
    share = ((539.5 - v) / 1.5 + 20.0) / 102.0
    held = np.clip(share, 0.0, 1.0)
    middle_u = 959.5 + 1.5 * (100.0 + 48.0 * (0.85 * held) ** 1.5)
    is_level = (share >= 0.0) & (share <= 1.0)
    chords = is_level & (np.abs(u - middle_u) <= 1.5 * 30.0 * (0.3 + 0.7 * np.sqrt(held)))
    whole = drawn(DriftingPlume(plume()), pose_of(300.0)) > 0
    mask = whole[300:700, 1000:1400]
    assert np.count_nonzero(mask) == np.count_nonzero(whole)
    assert np.count_nonzero(mask & chords) > 0.93 * np.count_nonzero(mask | chords)  # edges are rounded outwards


@pytest.mark.parametrize("north_m", [-800.0, 0.0])
def test_a_plume_behind_the_camera_draws_nothing(north_m: float) -> None:
    target = DriftingPlume(Plume(np.array([0.0, north_m, 0.0]), 120.0, 60.0, np.array([0.0, -4.0, 0.0])))
    assert not drawn(target, pose_of(0.0)).any()
