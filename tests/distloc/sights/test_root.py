"""Where a plume's root is and how the smoke leans over it, on drawn outlines."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.sights.root import foot_of


def plume(lean: float, height: int = 120, root: float = 8.0, spread: float = 0.5) -> NDArray[np.uint8]:
    """A plume's pixels in their box: it begins `root` wide, leans by `lean` and widens by `spread` for each row up."""
    mask = np.zeros((height, 900), np.uint8)
    rows = np.arange(height)
    middles, halves = 450.0 + lean * rows, (root + spread * rows) / 2.0
    for row, middle, half in zip(rows, middles, halves, strict=True):
        mask[height - 1 - row, round(middle - half) : round(middle + half)] = 1
    x, y, width, tall = cv2.boundingRect(mask)
    return np.ascontiguousarray(mask[y : y + tall, x : x + width])


@pytest.mark.parametrize("lean", [-2.0, -0.7, 0.0, 0.7, 2.0])
def test_the_root_stays_where_the_fire_is_however_the_smoke_leans(lean: float) -> None:
    pixels = plume(lean)
    left = int(np.flatnonzero(pixels[-1])[0])
    foot = foot_of(pixels)
    assert foot.middle == pytest.approx(left + 3.5, abs=2.0)  # the middle of the box is up to 130 off
    assert foot.lean == pytest.approx(lean, abs=0.2)
    assert foot.width == pytest.approx(8.0 / np.hypot(1.0, lean), abs=1.5)  # across the lean


def test_of_a_box_the_root_is_as_wide_as_it_is_and_leans_nowhere() -> None:
    foot = foot_of(np.ones((40, 21), np.uint8))
    assert (foot.middle, foot.width, foot.lean) == (10.0, 21.0, 0.0)
    assert foot.is_at_left and foot.is_at_right


def test_a_hidden_foot_leaves_a_wider_root() -> None:
    whole = plume(0.5)
    cut = np.ascontiguousarray(whole[:-50])
    assert foot_of(cut).width > 2.0 * foot_of(whole).width


def test_a_single_row_and_a_single_pixel_have_a_root() -> None:
    assert foot_of(np.ones((1, 9), np.uint8)).middle == 4.0
    one = foot_of(np.ones((1, 1), np.uint8))
    assert (one.middle, one.width, one.lean) == (0.0, 1.0, 0.0)
