"""Each landscape is drawn, is what its name says, and moves where it should."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.sensor import compressed
from distloc.types import CameraPose
from tests.distloc.simulation.landscape.truth import CAMERA, pose_at

AT_HOME = pose_at(0.0, 0.0)


def drawn(name: str, seed: int = 3, **changes: float) -> LandscapeRenderer:
    return LandscapeRenderer(CAMERA, [], np.random.default_rng(seed), replace(SCENES[name], **changes))


@pytest.fixture(scope="module")
def pictures() -> dict[str, np.ndarray]:
    return {name: drawn(name).render(AT_HOME)[0] for name in SCENES}


def corners(image: np.ndarray) -> int:
    grey = cv2.cvtColor(cv2.GaussianBlur(image, (3, 3), 0), cv2.COLOR_BGR2GRAY)
    return len(cv2.FastFeatureDetector.create(14).detect(grey))


def test_each_is_a_picture(pictures: dict[str, np.ndarray]) -> None:
    for image in pictures.values():
        assert image.shape == (360, 640, 3) and image.dtype == np.uint8
    assert len({image.tobytes() for image in pictures.values()}) == len(SCENES)


def test_each_is_what_its_name_says(pictures: dict[str, np.ndarray]) -> None:
    brightness = {name: float(image[220:].mean()) for name, image in pictures.items()}
    assert brightness["night"] < 15.0 and 50.0 < brightness["hills"] < 150.0 and brightness["snow"] > 180.0
    assert pictures["night"].max() > 120  # a lamp
    many = corners(pictures["hills"])
    assert many > 200
    assert max(corners(pictures[name]) for name in ("sea", "snow", "few_corners")) < 0.25 * many
    far = {name: float(image[150:175].std()) for name, image in pictures.items()}
    assert far["haze"] < 0.5 * far["hills"]


def test_the_same_seed_draws_the_same_and_another_does_not() -> None:
    first, again, other = (drawn("hills", seed).render(AT_HOME)[0] for seed in (4, 4, 5))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_the_noise_is_new_in_each_frame_and_as_large_as_it_says() -> None:
    scene = drawn("snow", cars_km=0.0, cloud_cover=0.0, light=0.5)
    first, second = (scene.render(at(AT_HOME, stamp_s))[0].astype(float) for stamp_s in (1.0, 1.2))
    apart = (first - second)[:60]
    assert 0.85 * 1.6 < apart.std() / np.sqrt(2.0) < 1.15 * 1.6
    assert abs(np.corrcoef(apart[:-1].ravel(), apart[1:].ravel())[0, 1]) < 0.05


def at(pose: CameraPose, stamp_s: float) -> CameraPose:
    return replace(pose, stamp_s=stamp_s)


def moved(scene: LandscapeRenderer, seconds: float = 2.0) -> float:
    """By how many grey levels the land changes while the camera stands still."""
    first, second = (scene.render(at(AT_HOME, stamp_s))[0].astype(float)[200:] for stamp_s in (1.0, 1.0 + seconds))
    return float(np.abs(first - second).mean())


def test_what_moves() -> None:
    assert moved(drawn("hills", noise=0.0, cars_km=0.0)) == 0.0
    assert moved(drawn("sea", noise=0.0)) > 3.0
    assert moved(drawn("traffic", noise=0.0, cars_km=0.0), 60.0) > 0.3  # the clouds' shadows
    assert moved(drawn("traffic", noise=0.0, cloud_shadow=0.0)) > 0.0  # the cars
    hills = drawn("hills", noise=0.0)
    skies = [hills.render(at(AT_HOME, stamp_s))[0].astype(float)[:80] for stamp_s in (1.0, 20.0)]
    assert np.abs(skies[0] - skies[1]).mean() > 1.0


def test_cars_stay_on_the_road() -> None:
    scene = drawn("traffic")
    for stamp_s in (0.0, 7.0, 100.0):
        east, north, up = scene.cars.at(stamp_s).base_enu_m.astype(np.float32).reshape(3, 1, -1)
        assert east.size > 100
        assert (scene.roads.share(east, north, np.full_like(east, 0.1)) > 0.9).all()
        assert up == pytest.approx(scene.terrain.height_m(east, north), abs=0.01)


@pytest.mark.parametrize("angles_deg", [(0, -89, 0), (30, 60, 0), (30, -30, 170), (0, 0, 90)])
def test_any_way_the_camera_looks_is_drawn(angles_deg: tuple[float, ...]) -> None:
    scene = drawn("hills")
    image, mask = scene.render(pose_at(100.0, 50.0, 130.0, angles_deg))
    assert image.std() > 1.0 and not mask.any()
    assert scene.render(pose_at(0.0, 0.0, 0.0, angles_deg))[0].shape == image.shape  # on the ground


def test_jpeg_of_a_low_quality_shows_its_blocks(pictures: dict[str, np.ndarray]) -> None:
    image = pictures["hills"]
    assert compressed(image, None) is image
    off = [np.abs(compressed(image, quality).astype(int) - image).mean() for quality in (95, 30)]
    assert off[0] < 0.5 * off[1]
