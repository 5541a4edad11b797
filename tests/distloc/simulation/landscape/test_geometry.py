"""What is drawn lies where it is, from every pose: else the world bends, and that looks like an error of attitude."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from distloc.simulation.landscape.ground import Places
from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES, Scene
from distloc.simulation.landscape.things import CONIFER, MAST, Boxes, Uprights
from distloc.types import CameraPose
from tests.distloc.simulation.landscape.truth import CAMERA, height, met, pose_at, seen

_NO_THINGS = {"trees_km2": 0.0, "houses_km2": 0.0, "masts_km2": 0.0, "cars_km": 0.0}
BARE = replace(SCENES["hills"], noise=0.0, haze_range_m=30_000.0, **_NO_THINGS)
LEVEL = replace(BARE, hill_height_m=0.0, contrast=0.0, has_roads=False, forest_bgr=BARE.field_bgr)
_HALF = 12  # of a window, in pixels


def renderer(scene: Scene, seed: int = 3) -> LandscapeRenderer:
    return LandscapeRenderer(CAMERA, [], np.random.default_rng(seed), scene)


class Checks:
    """A ground painted with waves of 40 m, which show where they are to a hundredth of a pixel."""

    def colours(self, place: Places, stamp_s: float) -> np.ndarray:
        waves = [np.sin(axis * np.float32(2.0 * np.pi / 40.0)) for axis in (place.east_m, place.north_m)]
        seen = np.clip(1.5 - place.along_m / 20.0, 0.0, 1.0)
        return np.repeat((120.0 + 50.0 * seen * (waves[0] + waves[1]))[None], 3, axis=0)

    def sky(self, directions: np.ndarray, position_enu_m: np.ndarray, stamp_s: float) -> np.ndarray:
        return np.full_like(directions, 230.0)


@pytest.fixture(scope="module")
def checked() -> LandscapeRenderer:
    drawn = renderer(replace(BARE, haze_range_m=1e9))
    drawn.ground = Checks()  # type: ignore[assignment]
    return drawn


@pytest.fixture(scope="module")
def bare() -> LandscapeRenderer:
    return renderer(BARE)


def seen_from(drawn: LandscapeRenderer, first: CameraPose, second: CameraPose, u: int, v: int) -> np.ndarray | None:
    """Where what the first pose shows in a window about (u, v) is in the second (2, S, S); None where hidden or out."""
    corners = np.stack(np.meshgrid([u - _HALF, u, u + _HALF], [v - _HALF, v, v + _HALF])).reshape(2, -1).astype(float)
    places = met(drawn.terrain, first, corners)
    there = seen(second, places)
    if not np.isfinite(there).all() or (there < 2).any() or (there[0] > 637).any() or (there[1] > 357).any():
        return None
    range_m = np.linalg.norm(places - first.position_enu_m[:, None], axis=0)
    if range_m.max() > 1.5 * range_m.min():  # a crest runs through it
        return None
    if np.linalg.norm(met(drawn.terrain, second, there) - places, axis=0).max() > 1.0:
        return None
    x = np.arange(-_HALF, _HALF + 1) / _HALF
    through = np.stack([x * (x - 1.0) / 2.0, 1.0 - x * x, x * (x + 1.0) / 2.0])  # Lagrange's, through the 3 by 3
    return np.einsum("iab,ax,by->ixy", there.reshape(2, 3, 3), through, through)


def shift_px(
    drawn: LandscapeRenderer, first: CameraPose, second: CameraPose, windows: list[tuple[int, int]]
) -> tuple[np.ndarray, int]:
    """By how much (2,) the windows of the first pose are off their places in the second (Lucas and Kanade 1981), and
    how many of them both poses see."""
    here, there = (
        cv2.cvtColor(drawn.render(pose)[0], cv2.COLOR_BGR2GRAY).astype(np.float32) for pose in (first, second)
    )
    normal, off, seen_by_both = np.zeros((2, 2)), np.zeros(2), 0
    for u, v in windows:
        maps = seen_from(drawn, first, second, u, v)
        if maps is None:
            continue
        one = here[v - _HALF : v + _HALF + 1, u - _HALF : u + _HALF + 1]
        other = cv2.remap(there, *maps.astype(np.float32), cv2.INTER_CUBIC)
        gradient = np.stack(np.gradient(0.5 * (one + other))[::-1]).reshape(2, -1)
        normal += gradient @ gradient.T
        off += gradient @ ((one - one.mean()) - (other - other.mean())).ravel()
        seen_by_both += 1
    return np.linalg.solve(normal, off), seen_by_both


@pytest.mark.parametrize(
    ("offset_m", "angles_deg"), [((100.0, 0.0, 0.0), (0, -8, 0)), ((60.0, 80.0, 15.0), (-3, -10, 4))]
)
@pytest.mark.parametrize("rows", [range(165, 230, 8), range(230, 340, 12)])
@pytest.mark.parametrize("columns", [range(30, 280, 20), range(280, 440, 20), range(440, 620, 20)])
def test_the_ground_is_the_same_from_100_m_away(
    checked: LandscapeRenderer, offset_m: tuple[float, ...], angles_deg: tuple[float, ...], rows: range, columns: range
) -> None:
    first = pose_at(-1000.0, 1200.0)
    other = pose_at(*(first.position_enu_m + offset_m), angles_deg=angles_deg)
    shift, count = shift_px(checked, first, other, [(u, v) for v in rows for u in columns])
    assert count > 5
    assert np.hypot(*shift) < 0.1


def test_the_hills_are_hills(bare: LandscapeRenderer) -> None:
    pixels = np.stack(np.meshgrid(np.arange(10.0, 640, 40), np.arange(150.0, 350, 20))).reshape(2, -1)
    places = met(bare.terrain, pose_at(-1000.0, 1200.0), pixels)
    assert np.nanpercentile(places[2], 90) - np.nanpercentile(places[2], 10) > 30.0


@pytest.mark.parametrize("angles_deg", [(0, -8, 0), (40, -30, 12), (200, -89, 0)])
def test_ranges_are_those_of_a_slow_march(bare: LandscapeRenderer, angles_deg: tuple[float, ...]) -> None:
    pose = pose_at(-1000.0, 1200.0, angles_deg=angles_deg)
    rows, columns = (
        index.ravel() for index in np.meshgrid(np.arange(3, 180, 11), np.arange(3, 320, 17), indexing="ij")
    )
    pixels = np.stack([2.0 * columns + 0.5, 2.0 * rows + 0.5])
    places = met(bare.terrain, pose, pixels)
    range_m = bare.range_m(pose)[rows, columns]
    rays = pose.R_cam_from_enu.T @ CAMERA.rays(pixels)
    drawn = pose.position_enu_m[:, None] + rays * range_m
    is_land = np.isfinite(places[0]) & np.isfinite(range_m)
    assert (np.isfinite(places[0]) == np.isfinite(range_m))[rows > 80].mean() > 0.97  # the ridge may be off by a pixel
    above_m = drawn[2] - height(bare.terrain, drawn[0], drawn[1])
    off_px = 450.0 * np.abs(above_m / range_m)[is_land]
    assert np.percentile(off_px, 99) < 0.02
    apart = np.linalg.norm(drawn - places, axis=0) / range_m
    assert (apart[is_land] < 0.01).mean() > 0.99  # the same slope, not the one behind its crest


def with_mast(base: np.ndarray) -> LandscapeRenderer:
    drawn, one = renderer(LEVEL), np.ones(1)
    drawn.uprights = Uprights(base, 30.0 * one, one, np.full(1, MAST), 0.0 * one, np.full((3, 1), 238.0))
    return drawn


def with_house(base: np.ndarray) -> LandscapeRenderer:
    drawn, white = renderer(LEVEL), np.full((3, 1), 250.0)
    drawn.houses = Boxes(base, np.array([[10.0], [6.0], [8.0]]), np.full(1, 0.5), white, white, False)
    return drawn


@pytest.mark.parametrize("pose", [pose_at(0.0, 0.0), pose_at(100.0, 30.0, 90.0, (-12, -5, 7))])
def test_a_mast_stands_where_it_is(pose: CameraPose) -> None:
    base = np.array([[20.0], [300.0], [0.0]])
    before, after = (drawn.render(pose)[0].astype(float) for drawn in (renderer(LEVEL), with_mast(base)))
    cover = (after - before).mean(axis=2)
    top, foot = (seen(pose, base + np.array([[0.0], [0.0], [up]]))[:, 0] for up in (30.0, 0.0))
    rows = np.arange(int(min(top[1], foot[1])) + 3, int(max(top[1], foot[1])) - 2)
    where = (cover[rows] * np.arange(640.0)).sum(axis=1) / cover[rows].sum(axis=1)
    line = top[0] + (rows - top[1]) * (foot[0] - top[0]) / (foot[1] - top[1])
    drawn_levels = cover[rows].sum(axis=1)  # of the bright bands whole rows alone
    is_bright = drawn_levels > 0.9 * drawn_levels.max()
    assert np.count_nonzero(is_bright) > 12
    assert np.abs(where - line)[is_bright].max() < 0.1
    drawn_rows = np.flatnonzero((np.abs(cover) > 15.0).any(axis=1))
    assert [drawn_rows.min(), drawn_rows.max()] == pytest.approx([top[1], foot[1]], abs=1.0)


@pytest.mark.parametrize("pose", [pose_at(0.0, 0.0), pose_at(100.0, 30.0, 90.0, (-12, -5, 7))])
def test_a_house_stands_where_it_is(pose: CameraPose) -> None:
    base = np.array([[20.0], [300.0], [0.0]])
    before, after = (drawn.render(pose)[0].astype(float) for drawn in (renderer(LEVEL), with_house(base)))
    rows, columns = np.nonzero(np.abs(after - before).max(axis=2) > 40.0)
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    floor = turn @ np.array([[10.0, 10.0, -10.0, -10.0], [6.0, -6.0, 6.0, -6.0]])
    corners = np.vstack([np.tile(floor, 2), np.repeat([0.0, 8.0], 4)]) + base
    pixels = seen(pose, corners)
    for drawn_px, true_px in ((columns, pixels[0]), (rows, pixels[1])):
        assert drawn_px.min() == pytest.approx(true_px.min(), abs=1.0)
        assert drawn_px.max() == pytest.approx(true_px.max(), abs=1.0)


def on_cone(base: np.ndarray, height_m: float, radius_m: float, pose: CameraPose, pixels: np.ndarray) -> np.ndarray:
    """The places (3, N) on a conifer's crown that pixels (2, N) show, by small steps and bisection; NaN beside it."""
    rays = pose.R_cam_from_enu.T @ CAMERA.rays(pixels)
    start = pose.position_enu_m[:, None]

    def depth_m(way_m: np.ndarray) -> np.ndarray:
        offset = start[..., None] + rays[..., None] * way_m - base[..., None]
        return radius_m * (1.0 - offset[2] / height_m) / 0.88 - np.hypot(offset[0], offset[1])

    middle_m = np.linalg.norm(base[:, 0] - pose.position_enu_m)
    ways = np.arange(middle_m - 40.0, middle_m + 20.0, 0.25)
    is_in = depth_m(np.broadcast_to(ways, (rays.shape[1], ways.size))) > 0.0
    first = is_in.argmax(axis=1)
    low, high = ways[first - 1], ways[first]
    for _ in range(30):
        half = 0.5 * (low + high)
        is_before = depth_m(half[:, None])[:, 0] <= 0.0
        low, high = np.where(is_before, half, low), np.where(is_before, high, half)
    return np.where(is_in.any(axis=1), start + rays * high, np.nan)


def test_a_trees_leaves_stay_on_the_tree() -> None:
    base, one = np.array([[20.0], [170.0], [0.0]]), np.ones(1)
    drawn = renderer(LEVEL)
    drawn.uprights = Uprights(base, 60.0 * one, 14.0 * one, np.full(1, CONIFER), 2.0 * one, np.full((3, 1), 110.0))
    first, second = pose_at(0.0, 0.0, 60.0), pose_at(30.0, 5.0, 75.0, (-8, -14, 3))
    here, there = (
        cv2.cvtColor(drawn.render(pose)[0], cv2.COLOR_BGR2GRAY).astype(np.float32) for pose in (first, second)
    )
    top, foot = (seen(first, base + np.array([[0.0], [0.0], [up]]))[:, 0] for up in (48.0, 12.0))
    rows, columns = np.meshgrid(
        np.arange(int(top[1]), int(foot[1])), np.arange(int(top[0]) - 14, int(top[0]) + 15), indexing="ij"
    )
    places = on_cone(base, 60.0, 14.0, first, np.stack([columns.ravel(), rows.ravel()]).astype(float))
    maps = seen(second, places).reshape(2, *rows.shape)
    toward = second.position_enu_m[:2, None] - base[:2]
    is_seen = np.einsum("ij,ij->j", (places - base)[:2], np.broadcast_to(toward, (2, places.shape[1]))) > 0.0
    is_seen = (is_seen & np.isfinite(places[0])).reshape(rows.shape)
    one_view = here[rows, columns]
    other = cv2.remap(there, *np.nan_to_num(maps).astype(np.float32), cv2.INTER_CUBIC)
    gradient = np.stack(np.gradient(0.5 * (one_view + other))[::-1])[:, is_seen]
    shift = np.linalg.solve(gradient @ gradient.T, gradient @ (one_view - other)[is_seen])
    assert np.count_nonzero(is_seen) > 400
    assert np.corrcoef(one_view[is_seen], other[is_seen])[0, 1] > 0.9
    assert np.hypot(*shift) < 0.15


def test_a_plains_horizon_is_at_eye_level() -> None:
    sea = renderer(replace(SCENES["sea"], noise=0.0))
    for pose in (pose_at(0.0, 0.0, 120.0), pose_at(0.0, 0.0, 400.0, (30, -12, 0))):
        range_m = sea.range_m(pose)
        row = seen(pose, pose.position_enu_m[:, None] + pose.R_cam_from_enu.T @ [[0.0], [0.0], [1.0]] * [[1], [1], [0]])
        first = np.argmax(np.isfinite(range_m[:, 160]))
        assert 2.0 * first + 0.5 == pytest.approx(row[1, 0], abs=2.0)
