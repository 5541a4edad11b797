"""Which frames have no picture in them, live and in a replay."""

import json
import shutil
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.simulation.renderer import Renderer
from service.camera.blind import BLIND_NS, BlindWatch, contrast, has_picture
from service.common.messages import Frame
from service.config.load import load_config
from service.recordings.recording import Recording
from service.recordings.replay import replay
from service.simulator.scenario import camera_pose, load_scenario, plumes
from tests.support.places import CUT, DATA

FOLDERS = ("smoke_hpwren_smokeseg", "smoke_boreal_uav", "negatives_horizon_uav")
RNG = np.random.default_rng(0)
SIZES = [(180, 320), (720, 1280), (1080, 1920)]
SIGMA = 10.0  # a sensor's noise at full gain

Image = NDArray[np.uint8]


def flat(level: int, size: tuple[int, int], sigma: float = 0.0) -> Image:
    """One level all over, with noise of its own in each channel."""
    return np.clip(RNG.normal(level, sigma, (*size, 3)), 0, 255).astype(np.uint8)


def sees(image: Image | None) -> bool:
    return has_picture(Frame(0, "", image))


def rendered() -> Image:
    scenario = load_scenario("demo")
    renderer = Renderer(scenario.camera.camera(), plumes(scenario), np.random.default_rng(1))
    return renderer.render(camera_pose(scenario, 5.0, 5.0))[0]


def hazy(image: Image, share: float) -> Image:
    """So much of the contrast left, the rest white haze, behind a sensor's noise."""
    veiled = share * image + (1.0 - share) * 220.0
    return np.clip(RNG.normal(veiled, 2.0), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("sigma", [0.0, SIGMA])
def test_nothing_but_noise_is_no_picture(size: tuple[int, int], level: int, sigma: float) -> None:
    assert not sees(flat(level, size, sigma))


@pytest.mark.parametrize("size", SIZES)
def test_grey_noise_too_and_hot_pixels(size: tuple[int, int]) -> None:
    dark = flat(0, size)
    dark[:] = np.clip(RNG.normal(0.0, SIGMA, size), 0, 255).astype(np.uint8)[:, :, None]
    dark[RNG.integers(0, size[0], 50), RNG.integers(0, size[1], 50)] = 255
    assert not sees(dark)


@pytest.mark.parametrize(
    ("ground", "thing", "width", "height"),
    [(0, 255, 128, 72), (190, 120, 40, 120), (200, 170, 120, 200), (110, 200, 160, 120)],
    ids=["a fire at night", "a plume before an even sky", "smoke in even haze", "a hot spot in thermal grey"],
)
def test_the_one_thing_on_an_even_ground_is_a_picture(ground: int, thing: int, width: int, height: int) -> None:
    for across in range(40, 1000, 119):
        image = flat(ground, (720, 1280), 2.0)
        image[300 : 300 + height, across : across + width] = thing
        assert sees(image), across


def test_a_recorded_mask_without_its_frame_is_taken() -> None:
    assert sees(None)


def test_a_rendered_frame_in_thick_haze_is_a_picture() -> None:
    image = rendered()
    assert contrast(image) > 100.0
    assert sees(image) and sees(hazy(image, 0.15))


def test_a_low_horizon_under_an_even_sky_is_a_picture() -> None:
    image = flat(200, (720, 1280), 2.0)
    image[-80:] //= 2
    assert sees(image)


@pytest.mark.skipif(not all((DATA / name).is_dir() for name in FOLDERS), reason="no shared data")
def test_real_frames_are_pictures_by_far() -> None:
    paths = [path for name in FOLDERS for path in sorted((DATA / name / "images").iterdir())]
    images = [image for path in paths if (image := cv2.imread(str(path))) is not None]
    assert len(images) > 50
    for path, image in zip(paths, images, strict=True):
        picture = np.asarray(image, np.uint8)
        assert contrast(picture) > 100.0, path.name
        assert sees(hazy(picture, 0.1)), path.name


def test_blind_is_said_after_a_second_and_taken_back_by_one_picture() -> None:
    watch, picture = BlindWatch(), hazy(rendered(), 0.5)
    assert not watch.sees_nothing(Frame(0, "", picture)) and not watch.is_blind()
    assert watch.sees_nothing(Frame(1, "", flat(0, (180, 320), SIGMA)))
    assert watch.sees_nothing(Frame(1 + BLIND_NS, "", flat(0, (180, 320)))) and not watch.is_blind()
    assert watch.sees_nothing(Frame(2 + BLIND_NS, "", flat(255, (180, 320)))) and watch.is_blind()
    assert not watch.sees_nothing(Frame(3 + BLIND_NS, "", picture)) and not watch.is_blind()


def test_a_replay_rejects_them_and_localises_the_others(tmp_path: Path) -> None:
    copy = Path(shutil.copytree(CUT, tmp_path / "copy"))
    config = load_config(copy / "config.toml")
    config = msgspec.structs.replace(config, localizer=msgspec.structs.replace(config.localizer, n_particles=2000))
    localised = []
    for is_spoilt in (False, True):
        if is_spoilt:
            names = [path.stem for path in sorted((copy / "masks").iterdir())][20:30]
            (copy / "frames").mkdir()
            for name in names:
                cv2.imwrite(str(copy / "frames" / f"{name}.png"), flat(0, (180, 320), SIGMA))
        replay(Recording(copy), config, tmp_path / "out", seed=3)
        frames = json.loads((tmp_path / "out" / "status.json").read_bytes())["frames"]
        localised.append(frames["localised"])
        assert frames["rejected"].get("blind_frame", 0) == (10 if is_spoilt else 0)
    assert localised[1] == localised[0] - 10 > 50
