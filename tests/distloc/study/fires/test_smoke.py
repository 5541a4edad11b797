"""Simulated smoke: where its puffs go, what of it the camera sees, and where it lies in the picture."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.study.fires.cases import CAMERA
from distloc.study.fires.smoke import Smoke, SmokeLook, Source, directions_from
from distloc.types import CameraPose, FloatArray
from tests.support.cube_samples import R_NORTH

LOOK = SmokeLook(height_m=200.0, life_s=40.0)
STILL = np.zeros(3)
SOURCE = Source(np.array([0.0, 1500.0, 0.0]), LOOK, STILL, STILL)
WIND_EAST = np.array([5.0, 0.0, 0.0])


def smoke(source: Source = SOURCE, seed: int = 3) -> Smoke:
    return Smoke(source, np.random.default_rng(seed))


def pose(stamp_s: float, east_m: float = 0.0) -> CameraPose:
    return CameraPose(stamp_s, np.array([east_m, 0.0, 100.0]), R_NORTH)


def drawn(one: Smoke, at: CameraPose) -> NDArray[np.uint8]:
    mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    one.draw(mask, CAMERA, at)
    return mask


def pixel(at: CameraPose, place: FloatArray) -> FloatArray:
    return CAMERA.project((at.R_cam_from_enu @ (place - at.position_enu_m))[:, None])[0][:, 0]


def test_a_puff_drifts_with_the_wind_at_each_height_that_it_rises_through() -> None:
    puffs = smoke(replace(SOURCE, wind_enu_mps=WIND_EAST)).puffs(100.0)
    every_s = LOOK.life_s / 100
    born_s = np.arange(60.0, 100.0 + 1e-9, every_s)
    assert puffs.radii_m.size == born_s.size
    for index, born in enumerate(born_s):
        ages = np.linspace(0.0, 100.0 - born, 4000)
        heights = 200.0 * (ages / 40.0) ** 0.75
        drift_m = np.trapezoid(5.0 * (heights / 10.0) ** 0.15, ages)
        offset = puffs.centres_enu_m[:, index] - [drift_m, 1500.0, heights[-1]]
        assert (np.abs(offset) <= 0.5 * puffs.radii_m[index] + 0.5).all()
    assert puffs.radii_m[-1] <= 1.15 * LOOK.root_m and puffs.radii_m[:80].max() > 2.0 * puffs.radii_m[-1]


def test_smoke_is_the_same_for_a_seed_and_a_time_and_flickers_with_time() -> None:
    one, again, other = smoke(), smoke(), smoke(seed=4)
    one.puffs(7.0)
    np.testing.assert_array_equal(one.puffs(100.0).centres_enu_m, again.puffs(100.0).centres_enu_m)
    assert (drawn(one, pose(100.0)) != drawn(other, pose(100.0))).any()
    assert (drawn(one, pose(100.0)) != drawn(one, pose(103.0))).any()


def test_the_foot_is_over_the_source_and_the_top_leans_with_the_wind() -> None:
    for wind, side in ((STILL, 0.0), (WIND_EAST, 1.0), (-WIND_EAST, -1.0)):
        at = pose(100.0)
        mask = drawn(smoke(replace(SOURCE, wind_enu_mps=wind)), at)
        rows = np.flatnonzero(mask.any(axis=1))
        (u, v) = pixel(at, SOURCE.place_enu_m)
        foot = np.flatnonzero(mask[rows[-1]]).mean()
        assert abs(foot - u) < 5.0 and abs(rows[-1] - v) < 5.0
        top = np.flatnonzero(mask[rows[0] + 3]).mean()
        assert abs(top - u) < 15.0 if side == 0.0 else side * (top - u) > 40.0
        count, *_ = cv2.connectedComponents(mask)
        assert count == 2  # the ground and one segment


def test_what_is_behind_trees_is_cut_away_and_nothing_else() -> None:
    at = pose(100.0, 300.0)
    whole, hidden = drawn(smoke(), at), drawn(smoke(replace(SOURCE, hidden_m=60.0)), at)
    (_, v) = pixel(at, SOURCE.place_enu_m + np.array([0.0, 0.0, 60.0]))
    rows = np.flatnonzero(hidden.any(axis=1))
    assert rows[-1] == pytest.approx(v, abs=1.0)
    np.testing.assert_array_equal(hidden[: int(v)], whole[: int(v)])
    assert whole[int(v) + 2 :].any()


def test_a_fire_that_was_lit_grows_and_one_that_puffs_rests() -> None:
    lit = smoke(replace(SOURCE, look=replace(LOOK, height_m=500.0, life_s=200.0), lit_s=(10.0, np.inf)))
    assert not drawn(lit, pose(9.0)).any()
    tops = [lit.puffs(stamp_s).centres_enu_m[2].max() for stamp_s in (20.0, 60.0, 150.0)]
    assert tops[0] < 80.0 and 1.5 * tops[0] < tops[1] and 1.5 * tops[1] < tops[2]
    puffing = smoke(replace(SOURCE, look=replace(LOOK, life_s=12.0, puffing_s=(15.0, 25.0))))
    is_seen = np.array([puffing.puffs(stamp_s).radii_m.size > 1 for stamp_s in np.arange(0.0, 400.0, 0.5)])
    assert is_seen.mean() == pytest.approx(27.0 / 40.0, abs=0.03)  # the last puff of each lives on
    assert np.count_nonzero(np.diff(is_seen.astype(int)) == 1) in (9, 10)


def test_a_source_that_moves_leaves_its_smoke_behind() -> None:
    moving = smoke(replace(SOURCE, velocity_enu_mps=np.array([10.0, 0.0, 0.0])))
    puffs = moving.puffs(50.0)
    np.testing.assert_allclose(moving.source.at(50.0), [500.0, 1500.0, 0.0])
    assert puffs.centres_enu_m[0, -1] == pytest.approx(500.0, abs=10.0)
    assert puffs.centres_enu_m[0, 0] == pytest.approx(100.0, abs=30.0)


def test_the_box_of_directions_holds_source_and_smoke() -> None:
    least, most = smoke(replace(SOURCE, wind_enu_mps=WIND_EAST)).direction_box(pose(100.0))
    assert -0.02 < least[0] <= 0.0 and 0.1 < most[0] < 0.3  # azimuths to the right of the source
    assert least[1] == pytest.approx(np.arctan2(-100.0, 1500.0), abs=0.01) and 0.04 < most[1] < 0.1
    south = directions_from(np.zeros(3), np.array([[-1.0], [-100.0], [0.0]]), np.array([1.0, -100.0, 0.0]))
    np.testing.assert_allclose(south[:, 0], [0.02, 0.0], atol=1e-4)  # across the cut of azimuth


def test_smoke_behind_or_beside_the_camera_is_not_drawn() -> None:
    for place in ([0.0, -1500.0, 0.0], [9000.0, 100.0, 0.0]):
        mask = drawn(smoke(replace(SOURCE, place_enu_m=np.array(place), wind_enu_mps=-WIND_EAST)), pose(100.0))
        assert not mask.any()
    inside = replace(SOURCE, place_enu_m=np.array([0.0, 10.0, 40.0]))
    assert drawn(smoke(inside), pose(100.0)).all()  # a camera in the smoke sees nothing else


@pytest.mark.parametrize(
    "changed", [{"height_m": 0.0}, {"life_s": -1.0}, {"root_m": float("nan")}, {"puffing_s": (0.0, 1.0)}]
)
def test_impossible_smoke_is_refused(changed: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="sizes and times must be > 0"):
        replace(LOOK, **changed)  # type: ignore[arg-type]
