"""Plumes that have grown together are told apart by their feet, and one plume is one."""

import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.sights.components import Component
from distloc.sights.feet import plumes_of

LEAST = 12


def cone(
    picture: NDArray[np.uint8], foot: tuple[int, int], height: int, lean: float = 0.0, spread: float = 0.3
) -> None:
    """Smoke that stands at a foot (column, row), 4 wide there, leans to the right and widens."""
    column, row = foot
    for up in range(height):
        middle, half = column + lean * up, 2.0 + spread * up
        picture[row - up, max(round(middle - half), 0) : round(middle + half) + 1] = 1


def of(picture: NDArray[np.uint8]) -> Component:
    rows, columns = np.nonzero(picture)
    top, left = int(rows.min()), int(columns.min())
    return Component(left, top, rows.size, picture[top : rows.max() + 1, left : columns.max() + 1])


@pytest.mark.parametrize("lean", [0.0, 0.4, -0.8])
@pytest.mark.parametrize("size", [1, 3])
def test_plumes_that_touch_above_are_as_many_as_their_feet(lean: float, size: int) -> None:
    picture = np.zeros((120 * size, 300 * size), np.uint8)
    feet = [(120 * size, 100 * size), (145 * size, 96 * size), (168 * size, 104 * size)]
    for foot in feet:
        cone(picture, foot, 60 * size, lean)
    whole = of(picture)
    plumes = plumes_of(whole, LEAST)
    assert len(plumes) == 3
    assert sum(one.area for one in plumes) == whole.area == picture.sum()
    for (column, row), one in zip(feet, plumes, strict=True):
        assert one.top + one.pixels.shape[0] - 1 == row  # its lowest pixels are its foot
        lowest = np.flatnonzero(one.pixels[-1]) + one.left
        assert lowest.mean() == pytest.approx(column, abs=2.5)
        rows, columns = np.nonzero(one.pixels)
        assert picture[rows + one.top, columns + one.left].all()
        assert one.pixels.any(axis=0).all() and one.pixels[0].any()


def test_smoke_that_is_lumpy_beneath_is_one_plume() -> None:
    picture = np.zeros((150, 400), np.uint8)
    cone(picture, (100, 140), 100, lean=1.5, spread=0.25)
    rng = np.random.default_rng(4)
    for at in range(20, 100, 12):  # half-discs under it
        rows, columns = np.ogrid[:150, :400]
        radius, column = rng.uniform(4.0, 9.0), 100 + 1.5 * at
        picture[(rows - (140 - at)) ** 2 + (columns - column) ** 2 <= radius**2] = 1
    assert len(plumes_of(of(picture), LEAST)) == 1


def test_a_ragged_edge_of_trees_makes_no_feet() -> None:
    picture = np.zeros((200, 200), np.uint8)
    cone(picture, (100, 199), 200, spread=0.4)
    trees = 140 + np.random.default_rng(2).integers(0, 6, 200)
    picture[np.arange(200)[:, None] > trees] = 0
    assert len(plumes_of(of(picture), LEAST)) == 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (3, 3)])
def test_the_smallest_are_one(shape: tuple[int, int]) -> None:
    whole = of(np.ones(shape, np.uint8))
    assert [one is whole for one in plumes_of(whole, LEAST)] == [True]


def test_a_foot_with_too_few_pixels_stays_with_its_neighbour() -> None:
    picture = np.zeros((60, 60), np.uint8)
    picture[:20] = 1
    picture[20:50, 10:20] = 1
    picture[20:26, 59] = 1
    assert len(plumes_of(of(picture), 300)) == 1
