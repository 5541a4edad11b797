"""Pictures from a broken stream are refused, and no others."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from service.camera.garbled import GarbleWatch
from service.common.messages import Frame
from service.simulator.spoilable_camera import SpoilableCamera
from tests.faults.scene import ROUND_THE_PLUME
from tests.support.places import DATA

Image = NDArray[np.uint8]


def frame(image: Image | None) -> Frame:
    return Frame(0, "", image)


def broken(seed: int) -> list[Image]:
    """What OpenCV makes of JPEGs with wrong bytes in the scan."""
    camera = SpoilableCamera(ROUND_THE_PLUME, 0, seed)
    camera.is_corrupt = True
    pictures = [camera.picture(number * 700_000_000) for number in range(120)]
    return [picture for picture in pictures if picture is not None]


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_broken_jpegs_are_refused(seed: int, capfd: pytest.CaptureFixture[str]) -> None:
    pictures = broken(seed)
    assert len(pictures) >= 30
    assert sum(not GarbleWatch().is_garbled(frame(picture)) for picture in pictures) <= 2


def test_whole_pictures_of_a_flight_are_taken() -> None:
    camera, watch = SpoilableCamera(ROUND_THE_PLUME, 0), GarbleWatch()
    assert not any(watch.is_garbled(frame(camera.picture(number * 200_000_000))) for number in range(100))


def test_what_stays_is_part_of_the_picture() -> None:
    rng, watch = np.random.default_rng(1), GarbleWatch()
    given = []
    for _ in range(10):
        picture = rng.integers(90, 110, (360, 640, 3), dtype=np.uint8)
        picture[:40] = picture[320:] = 0  # the black bars of another shape of picture
        given.append(watch.is_garbled(frame(picture)))
    assert given == [True] * 3 + [False] * 7


@pytest.mark.parametrize("sigma", [0.0, 20.0, 80.0])
def test_noise_is_no_break(sigma: float) -> None:
    rng = np.random.default_rng(2)
    picture = np.clip(rng.normal(128.0, sigma, (360, 640, 3)), 0, 255).astype(np.uint8)
    assert not GarbleWatch().is_garbled(frame(picture))
    assert not GarbleWatch().is_garbled(frame(None))
    assert not GarbleWatch().is_garbled(frame(picture[:10]))


@pytest.mark.skipif(not DATA.is_dir(), reason="the recorded pictures are not here")
def test_real_pictures_are_taken() -> None:
    names = [
        *sorted(DATA.glob("smoke_*/images/*.jpg"))[::4],
        *sorted(DATA.glob("negatives_*/images/*.jpg"))[::4],
    ]
    assert len(names) > 100
    assert [
        name.name for name in names if GarbleWatch().is_garbled(frame(np.asarray(cv2.imread(str(name)), np.uint8)))
    ] == []
