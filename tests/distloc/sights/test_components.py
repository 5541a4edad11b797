"""Components and what is measured of them, against labelling the whole mask and going over every pixel."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.sights.components import largest_components
from distloc.sights.detections import MAX_DETECTIONS, MIN_AREA_PX, detections_from_mask
from distloc.sights.feet import plumes_of

Mask = NDArray[np.uint8]


def all_components(mask: Mask) -> list[tuple[int, int, int, bytes]]:
    """Area, top, left and pixels of each component, the largest first."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((mask > 0).view(np.uint8), connectivity=8)
    found = []
    for label in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[label])
        pixels = (labels[top : top + height, left : left + width] == label).view(np.uint8)
        found.append(((-area, top, left + int(pixels[0].argmax())), (area, top, left, pixels.tobytes())))
    return [one for _, one in sorted(found)]


def found_in(mask: Mask, least_area: int = 1, most: int = 10_000) -> list[tuple[int, int, int, bytes]]:
    return [(one.area, one.top, one.left, one.pixels.tobytes()) for one in largest_components(mask, least_area, most)]


def blobs(rng: np.random.Generator, shape: tuple[int, int]) -> Mask:
    mask: Mask = np.zeros(shape, np.uint8)
    for _ in range(rng.integers(1, 25)):
        centre = (int(rng.integers(shape[1])), int(rng.integers(shape[0])))
        axes = (int(rng.integers(1, 40)), int(rng.integers(1, 25)))
        thickness = int(rng.choice([-1, 1, 3]))
        cv2.ellipse(mask, centre, axes, float(rng.uniform(0, 180)), 0.0, 360.0, 255, thickness)
    return mask


def rings(shape: tuple[int, int]) -> Mask:
    mask: Mask = np.zeros(shape, np.uint8)
    for radius in range(3, 120, 6):
        cv2.circle(mask, (shape[1] // 2, shape[0] // 2), radius, 1, 1)
    return mask


def stripes(shape: tuple[int, int]) -> Mask:
    mask: Mask = np.zeros(shape, np.uint8)
    for offset in range(0, shape[1], 40):
        cv2.line(mask, (offset, 0), (offset - shape[0], shape[0]), 1, 2)
    return mask


def check(mask: Mask, least_area: int = 1, most: int = 10_000) -> None:
    expected = [one for one in all_components(mask) if one[0] >= least_area][:most]
    assert found_in(mask, least_area, most) == expected


@pytest.mark.parametrize("shape", [(240, 320), (241, 317), (7, 5), (8, 8), (1, 300)])
def test_the_same_components_as_of_the_whole_mask(shape: tuple[int, int]) -> None:
    for seed in range(40):
        rng = np.random.default_rng([seed, *shape])
        mask = blobs(rng, shape)
        check(mask)
        check(mask, least_area=MIN_AREA_PX, most=4)
        check(np.where(rng.random(shape) < 0.02, np.uint8(1), mask), least_area=3, most=MAX_DETECTIONS)


@pytest.mark.parametrize("density", [0.0, 0.001, 0.05, 0.3, 0.5, 0.9, 1.0])
def test_the_same_of_noise(density: float) -> None:
    mask = (np.random.default_rng(0).random((243, 331)) < density).astype(np.uint8)
    check(mask)
    check(mask, least_area=MIN_AREA_PX, most=MAX_DETECTIONS)


def test_the_same_where_one_lies_in_another() -> None:
    for mask in (rings((250, 250)), stripes((250, 330))):
        check(mask)
        check(mask, least_area=MIN_AREA_PX, most=5)


def slow_foot(pixels: NDArray[np.bool_]) -> float:
    """The middle of the root at its lower edge: from the bottom until half as high as wide, or 15 % of the pixels."""
    height, total = pixels.shape[0], int(pixels.sum())
    rise = next(
        n
        for n in range(1, height + 1)
        if (area := int(pixels[height - n :].sum())) >= 0.15 * total or (n * n >= area / 2.0 and area >= 0.01 * total)
    )
    root, over = pixels[height - rise :], pixels[max(height - rise - max(rise, round(0.2 * height)), 0) : height - rise]
    middle = float(np.nonzero(root)[1].mean())
    lean = 0.0
    if len(over):
        lean = (float(np.nonzero(over)[1].mean()) - middle) / ((rise + len(over)) / 2.0)
    columns = np.nonzero(root)[1]
    return float(np.clip(middle - np.clip(lean, -4.0, 4.0) * rise / 2.0, columns.min(), columns.max()))


@pytest.mark.parametrize("scale", [1, 2, 3])
def test_what_is_measured_is_what_the_pixels_say(scale: int) -> None:
    camera, compared = Camera(960, 720, 700.0, 700.0, 480.0, 360.0), 0
    for seed in range(30):
        mask = blobs(np.random.default_rng([9, seed]), (720 // scale, 960 // scale))
        found = detections_from_mask(mask, camera)
        expected = [one for one in all_components(mask) if one[0] >= MIN_AREA_PX][:MAX_DETECTIONS]
        segments = largest_components(mask, MIN_AREA_PX, MAX_DETECTIONS)
        assert len(segments) == len(expected)
        plumes = [plume for segment in segments for plume in plumes_of(segment, MIN_AREA_PX)][:MAX_DETECTIONS]
        for one, component in zip(found, plumes, strict=True):
            rows, columns = np.nonzero(component.pixels)
            u = (columns + component.left) * scale + (scale - 1) / 2.0
            v = (rows + component.top) * scale + (scale - 1) / 2.0
            assert one.centre_px == pytest.approx([(u.min() + u.max()) / 2.0, (v.min() + v.max()) / 2.0])
            foot = slow_foot(component.pixels.astype(bool))
            assert one.base_px == pytest.approx([foot * scale + u.min(), v.max() + scale / 2.0])
            covariance = np.cov(np.stack([u, v]), bias=True) + np.eye(2) * scale**2 / 12.0
            assert one.covariance_px2 == pytest.approx(covariance, rel=1e-6, abs=1e-6)
            assert one.area_px == u.size * scale**2
            assert (one.width_px, one.height_px) == (np.ptp(u) + scale, np.ptp(v) + scale)
            compared += 1
    assert compared > 100
