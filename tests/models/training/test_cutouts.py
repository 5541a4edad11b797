"""Smoke cut from a frame: what was laid over a background comes back as opacity and brightness."""

import cv2
import numpy as np
import pytest

from cutouts import cut_out
from frames import NOT_SMOKE, SMOKE, Background, draw_frame
from plumes import LEAST_PX, SIDE

W, H = 320, 240


def frame(x: float = 160.0, y: float = 110.0, radius: float = 20.0, opacity: float = 0.8) -> Background:
    """Grey smoke, a round puff that thins out, over green land under a blue sky."""
    image = np.full((H, W, 3), (60.0, 90.0, 70.0), np.float32)
    image[:60] = (200.0, 150.0, 110.0)
    columns, rows = np.meshgrid(np.arange(W), np.arange(H))
    thick = opacity * np.clip(1.5 - np.hypot(columns - x, rows - y) / radius, 0.0, 1.0)
    image += thick[..., None].astype(np.float32) * (np.float32(215.0) - image)
    label = np.where(thick > 0.08, SMOKE, NOT_SMOKE).astype(np.uint8)
    sky = np.zeros((H, W), np.uint8)
    return Background(image.astype(np.uint8), label, sky, (60.0, 60.0), np.full(3, 210.0, np.float32))


def test_the_middle_hides_more_than_the_edge_and_nothing_lies_outside() -> None:
    smoke = cut_out(frame())
    assert smoke is not None
    middle = SIDE // 2
    assert smoke.opacity[middle, middle] > 0.9
    assert 0.0 < smoke.opacity[middle, middle + 52] < 0.6  # 0.66 of the side is filled: its radius is 63
    assert smoke.opacity[:, [0, -1]].max() == 0.0 == smoke.opacity[[0, -1]].max()
    assert smoke.shade[middle, middle] == pytest.approx(1.0, abs=0.1)


def test_its_foot_is_its_lowest_part() -> None:
    smoke = cut_out(frame())
    assert smoke is not None
    assert smoke.foot[0] == pytest.approx(SIDE / 2, abs=4.0)
    assert smoke.foot[1] == pytest.approx(SIDE / 2 + 0.33 * SIDE, abs=4.0)


def test_smoke_that_the_frame_cuts_or_that_is_tiny_is_left_out() -> None:
    assert cut_out(frame(x=10.0)) is None
    assert cut_out(frame(radius=2.0)) is None
    assert cut_out(frame(opacity=0.0)) is None


def test_it_is_not_drawn_much_larger_than_it_was() -> None:
    smoke = cut_out(frame(radius=10.0))
    assert smoke is not None
    rng = np.random.default_rng(3)
    clear = frame(opacity=0.0)
    sizes = []
    for _ in range(30):
        _, label = draw_frame(rng, clear, [smoke])
        _, _, stats, _ = cv2.connectedComponentsWithStats((label == SMOKE).astype(np.uint8))
        sizes += [int(max(one[cv2.CC_STAT_WIDTH], one[cv2.CC_STAT_HEIGHT])) for one in stats[1:]]
    assert LEAST_PX / 2 < np.quantile(sizes, 0.9) < 1.3 * smoke.most_px  # a few touch another
