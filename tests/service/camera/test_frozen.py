import numpy as np

from service.camera.frozen import FROZEN_NS, FreezeWatch
from service.common.messages import Frame

RNG = np.random.default_rng(0)
SCENE = RNG.integers(0, 200, (180, 320, 3), dtype=np.uint8)


def noisy() -> np.ndarray:
    return SCENE + RNG.integers(0, 3, SCENE.shape, dtype=np.uint8)


def test_a_still_scene_with_noise_is_not_frozen() -> None:
    watch = FreezeWatch()
    assert not any(watch.is_repeated(Frame(k * FROZEN_NS, "", noisy())) for k in range(10))
    assert not watch.is_frozen()


def test_the_same_picture_is_refused_at_once_and_called_frozen_after_a_second() -> None:
    watch, image = FreezeWatch(), noisy()
    assert not watch.is_repeated(Frame(0, "", image))
    assert watch.is_repeated(Frame(FROZEN_NS, "", image.copy())) and not watch.is_frozen()
    assert watch.is_repeated(Frame(FROZEN_NS + 1, "", image.copy())) and watch.is_frozen()
    assert not watch.is_repeated(Frame(FROZEN_NS + 2, "", noisy())) and not watch.is_frozen()


def test_another_size_is_another_picture_and_no_picture_is_none() -> None:
    watch = FreezeWatch()
    assert not watch.is_repeated(Frame(0, "", SCENE))
    assert not watch.is_repeated(Frame(1, "", SCENE[::2, ::2]))
    assert not watch.is_repeated(Frame(2, "", None)) and not watch.is_repeated(Frame(3, "", None))


def test_a_small_thing_between_the_rows_that_are_compared_first_is_noticed() -> None:
    image = noisy()
    moved = image.copy()
    moved[5:11, 20:26] ^= 255
    watch = FreezeWatch()
    assert not watch.is_repeated(Frame(0, "", image)) and not watch.is_repeated(Frame(FROZEN_NS, "", moved))
    assert watch.is_repeated(Frame(2 * FROZEN_NS, "", moved.copy()))
