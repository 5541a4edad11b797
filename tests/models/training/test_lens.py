"""What a camera makes of a scene: always a picture, now and then without colour or corners."""

import numpy as np

from lens import as_taken


def scene() -> np.ndarray:
    rows = np.linspace(80.0, 190.0, 120, dtype=np.float32)[:, None, None]
    return np.broadcast_to(rows * np.array([1.2, 0.9, 0.8], np.float32), (120, 160, 3)).copy()


def test_the_same_seed_gives_the_same_picture() -> None:
    taken = [as_taken(np.random.default_rng(5), scene()) for _ in range(2)]
    assert np.array_equal(*taken) and taken[0].dtype == np.uint8 and taken[0].shape == (120, 160, 3)


def test_some_are_without_colour_and_some_have_black_corners() -> None:
    rng = np.random.default_rng(0)
    pictures = [as_taken(rng, scene()).astype(np.int16) for _ in range(120)]
    colour = [float(np.ptp(one, axis=2).mean()) for one in pictures]
    corner = [int(min(one[0, 0].max(), one[0, -1].max(), one[-1, 0].max(), one[-1, -1].max())) for one in pictures]
    assert 3 <= sum(one < 6.0 for one in colour) <= 50
    assert 3 <= sum(one < 10 for one in corner) <= 60
