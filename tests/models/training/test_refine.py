"""An outline's edge moves to the smoke's, within its band."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from outlines import Outlined, drawn_smoke, read_outlines
from refine import mask_from_outline

WIDTH, HEIGHT = 320, 240
INSIDE_PX, OUTSIDE_PX = 0.008 * WIDTH, 2.0  # the band at this width


def outlined(folder: Path, *lines: str) -> Outlined:
    path = folder / "outlines.txt"
    path.write_text("frame a\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return read_outlines(path)[0]


def kind(word: str, corners: NDArray[np.float64]) -> str:
    return f"{word} " + " ".join(f"{round(x)},{round(y)}" for x, y in corners)


def disc(radius: float) -> NDArray[np.float64]:
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    return np.stack([160.0 + radius * np.cos(turn), 110.0 + radius * np.sin(turn)], axis=1)


def ground(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Dark and rough."""
    rough = cv2.GaussianBlur(rng.normal(0.0, 40.0, (HEIGHT, WIDTH, 1)), (0, 0), 1.5)[..., None]
    return np.clip(np.array([60.0, 80.0, 85.0]) + rough, 0, 255).astype(np.uint8)


def with_smoke(image: NDArray[np.uint8], smoke: NDArray[np.uint8]) -> NDArray[np.uint8]:
    opacity = cv2.GaussianBlur(0.8 * (smoke > 0).astype(np.float64), (0, 0), 0.7)[..., None]
    return (image * (1.0 - opacity) + 205.0 * opacity).astype(np.uint8)


def iou(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    return float(((one > 0) & (other > 0)).sum() / ((one > 0) | (other > 0)).sum())


@pytest.mark.parametrize("off_px", [-1.5, 2.0])
def test_an_outline_drawn_too_narrow_or_too_wide_is_mended(tmp_path: Path, off_px: float) -> None:
    truth = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(truth, (160, 110), 40, 1, cv2.FILLED)
    one = outlined(tmp_path, kind("smoke", disc(40.0 + off_px)))
    mask = mask_from_outline(with_smoke(ground(np.random.default_rng(1)), truth), one)
    assert set(np.unique(mask)) == {0, 255}
    error = 1.0 - iou(mask, truth)
    assert error < 0.7 * (1.0 - iou(drawn_smoke(one, HEIGHT, WIDTH), truth))
    assert error < 0.07  # about 1 px: the smoke's own edge is soft


def test_the_edge_stays_in_its_band_where_nothing_tells_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    one = outlined(tmp_path, kind("smoke", disc(40.0)))
    drawn = drawn_smoke(one, HEIGHT, WIDTH)
    mask = mask_from_outline(rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8), one)
    within = cv2.distanceTransform(drawn, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    without = cv2.distanceTransform(1 - drawn, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    assert (mask[within >= INSIDE_PX] == 255).all()
    assert (mask[without > OUTSIDE_PX + 0.5] == 0).all()
    assert cv2.connectedComponents(mask)[0] == 2  # the ground and one smoke, no specks


def test_a_thin_base_is_kept_and_grows_no_thicker_than_twice(tmp_path: Path) -> None:
    truth = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(truth, (160, 110), 30, 1, cv2.FILLED)
    cv2.rectangle(truth, (158, 140), (161, 199), 1, cv2.FILLED)
    one = outlined(tmp_path, kind("smoke", disc(30.0)), "smoke 158,135 161,135 161,199 158,199")
    image = with_smoke(ground(np.random.default_rng(3)), np.where(np.arange(HEIGHT)[:, None] < 150, truth, 0))
    mask = mask_from_outline(image, one)  # the base is too faint to be told from the ground
    widths = (mask[150:200] > 0).sum(axis=1)
    assert widths.min() >= 2
    assert widths.max() <= 8
    assert np.flatnonzero(mask.any(axis=1)).max() >= 198


def test_what_is_clear_is_no_smoke(tmp_path: Path) -> None:
    truth = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.circle(truth, (160, 110), 40, 1, cv2.FILLED)
    one = outlined(tmp_path, kind("smoke", disc(40.0)), "clear 150,100 170,100 170,120 150,120")
    mask = mask_from_outline(with_smoke(ground(np.random.default_rng(4)), truth), one)
    assert (mask[100:121, 150:171] == 0).all()
    assert (mask[85:96, 140:181] == 255).all()


@pytest.mark.parametrize(
    "line",
    [
        "smoke 10,10 11,10 10,11",
        "smoke 10,10 10,10 10,10",
        "smoke 0,0 1,0 0,1",
        "smoke 319,239 320,240 319,240",
        f"smoke 0,0 {WIDTH},0 {WIDTH},{HEIGHT} 0,{HEIGHT}",
        f"smoke 0,0 {WIDTH},0 {WIDTH},{HEIGHT - 1} 0,{HEIGHT - 1}",
    ],
)
def test_a_speck_and_a_full_frame_are_masked_as_drawn(tmp_path: Path, line: str) -> None:
    one = outlined(tmp_path, line)
    image = ground(np.random.default_rng(5))
    mask = mask_from_outline(image, one)
    drawn = drawn_smoke(one, HEIGHT, WIDTH)
    assert (mask[drawn > 0] == 255).any()
    assert iou(mask, drawn) > 0.2
    assert (mask == mask_from_outline(image, one)).all()


def test_no_smoke_is_an_empty_mask(tmp_path: Path) -> None:
    one = outlined(tmp_path, "none")
    assert not mask_from_outline(ground(np.random.default_rng(6)), one).any()
