"""The smoke in a landscape: the mask is today's, less what a crest or a tree hides."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.things import BROADLEAF, Uprights
from distloc.simulation.plume import Plume
from distloc.simulation.renderer import Renderer
from tests.distloc.simulation.landscape.truth import CAMERA, height, met, pose_at

PLUME = Plume(np.array([0.0, 2000.0, 0.0]), 160.0, 120.0, np.array([2.0, 0.0, 0.0]))
BARE = {"trees_km2": 0.0, "houses_km2": 0.0, "masts_km2": 0.0, "cars_km": 0.0}


def masks(name: str, north_m: float, up_m: float) -> tuple[LandscapeRenderer, np.ndarray, np.ndarray]:
    scene = replace(SCENES[name], **BARE)
    drawn = LandscapeRenderer(CAMERA, [PLUME], np.random.default_rng(2), scene)
    pose = pose_at(0.0, north_m, up_m)
    return drawn, drawn.render(pose)[1], Renderer(CAMERA, [PLUME], np.random.default_rng(2)).render(pose)[1]


@pytest.mark.parametrize("name", ["flat", "sea"])
def test_where_nothing_hides_it_the_mask_is_the_flat_ones(name: str) -> None:
    _, mask, flat = masks(name, 1500.0, 120.0)
    assert np.array_equal(mask, flat) and mask.any()


def test_a_crest_hides_what_is_behind_it_and_nothing_else() -> None:
    drawn, mask, flat = masks("hills", 200.0, 15.0)
    pose = pose_at(0.0, 200.0, 15.0)
    pixels = np.argwhere(flat > 0)[:, ::-1].T.astype(float)
    places = met(drawn.terrain, pose, pixels)
    range_m = np.linalg.norm(PLUME.base_enu_m - pose.position_enu_m)
    is_hidden = np.linalg.norm(places - pose.position_enu_m[:, None], axis=0) < range_m - 350.0
    is_drawn = mask[pixels[1].astype(int), pixels[0].astype(int)] > 0
    assert 0.15 < is_hidden.mean() < 0.9, "the test's hill hides some of the plume"
    assert (is_drawn == ~is_hidden).mean() > 0.96  # but for the crest's own pixels
    assert not (mask[flat == 0]).any()


def test_the_ground_is_level_about_home_and_the_smoke() -> None:
    drawn, _, _ = masks("hills", 0.0, 120.0)
    around = np.linspace(0.0, 2.0 * np.pi, 60)
    for east, north in ((0.0, 0.0), (0.0, 2000.0)):
        assert height(drawn.terrain, east + 320.0 * np.cos(around), north + 320.0 * np.sin(around)) == pytest.approx(
            0.0
        )
    axis = np.arange(-4000.0, 4001.0, 50.0)
    high = height(drawn.terrain, *np.meshgrid(axis, axis))
    assert high.min() >= 0.0 and 40.0 < high.max() <= SCENES["hills"].hill_height_m + 0.1


def test_a_tree_before_the_smoke_is_taken_off_the_mask() -> None:
    drawn, mask, _ = masks("flat", 0.0, 60.0)
    one = np.ones(1)
    base = np.array([[0.0], [60.0], [0.0]])
    drawn.uprights = Uprights(base, 60.0 * one, 3.0 * one, np.full(1, BROADLEAF), 0.0 * one, np.full((3, 1), 60.0))
    image, less = drawn.render(pose_at(0.0, 0.0, 60.0))
    assert np.count_nonzero(less) < 0.9 * np.count_nonzero(mask)
    assert not (less[mask == 0]).any()
    taken = (mask > 0) & (less == 0)
    assert image[taken].mean() < 110.0  # a tree's colours, not smoke's
