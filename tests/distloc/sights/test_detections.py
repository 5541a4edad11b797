import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.sights.detections import MAX_DETECTIONS, detections_from_mask, joined

CAMERA = Camera(320, 240, 200.0, 200.0, 160.0, 120.0)


def mask_with(*boxes: tuple[int, int, int, int], scale: int = 1) -> np.ndarray:
    mask = np.zeros((240 // scale, 320 // scale), dtype=bool)
    for left, top, width, height in boxes:
        mask[top : top + height, left : left + width] = True
    return mask


def test_box_gives_centre_base_and_size() -> None:
    (found,) = detections_from_mask(mask_with((100, 50, 21, 41)), CAMERA)
    assert found.centre_px == pytest.approx([110.0, 70.0])
    assert found.base_px == pytest.approx([110.0, 90.5])  # the lower edge of the lowest pixel, row 90
    assert (found.area_px, found.width_px, found.height_px) == (21 * 41, 21.0, 41.0)
    assert found.covariance_px2 == pytest.approx(np.diag([21.0**2 / 12, 41.0**2 / 12]), abs=1e-6)
    assert found.sigma_px > 0


def test_base_is_below_the_foot_of_a_leaning_plume() -> None:
    mask = mask_with((100, 100, 10, 40), (100, 80, 90, 20))
    (found,) = detections_from_mask(mask, CAMERA)
    assert found.base_px == pytest.approx([104.5, 139.5])
    assert found.centre_px[0] > 120.0


@pytest.mark.parametrize(
    ("box", "is_cut", "is_base_cut"),
    [
        ((100, 50, 20, 20), (False, False), (False, False)),
        ((0, 50, 20, 20), (True, False), (True, False)),
        ((100, 0, 20, 20), (False, True), (False, False)),
        ((300, 50, 20, 20), (True, False), (True, False)),
        ((100, 220, 20, 20), (False, True), (False, True)),
        ((0, 220, 20, 20), (True, True), (True, True)),
        ((2, 2, 316, 236), (False, False), (False, False)),
    ],
)
def test_border(box: tuple[int, int, int, int], is_cut: tuple[bool, bool], is_base_cut: tuple[bool, bool]) -> None:
    (found,) = detections_from_mask(mask_with(box), CAMERA)
    assert (found.is_cut, found.is_base_cut, found.touches_border) == (is_cut, is_base_cut, any(is_cut))


def test_smoke_that_drifts_over_a_side_has_its_foot_whole() -> None:
    mask = mask_with((0, 50, 60, 20), (40, 60, 20, 60))
    (found,) = detections_from_mask(mask, CAMERA)
    assert (found.is_cut, found.is_base_cut) == ((True, False), (False, False))


@pytest.mark.parametrize("scale", [2, 4])
def test_fraction_mask_finds_the_same_box(scale: int) -> None:
    (whole,) = detections_from_mask(mask_with((80, 40, 40, 80)), CAMERA)
    box = (80 // scale, 40 // scale, 40 // scale, 80 // scale)
    (coarse,) = detections_from_mask(mask_with(box, scale=scale), CAMERA)
    assert coarse.centre_px == pytest.approx(whole.centre_px)
    assert coarse.base_px == pytest.approx(whole.base_px)
    assert (coarse.area_px, coarse.width_px, coarse.height_px) == (3200.0, 40.0, 80.0)
    assert coarse.covariance_px2 == pytest.approx(whole.covariance_px2, abs=1e-6)


def test_largest_first_and_specks_left_out() -> None:
    found = detections_from_mask(
        mask_with((10, 10, 4, 4), (50, 50, 30, 30), (150, 150, 10, 10), (300, 10, 3, 3)), CAMERA
    )
    assert [one.area_px for one in found] == [900.0, 100.0, 16.0]


def test_no_more_than_the_limit() -> None:
    boxes = [(8 * i + 4, 8 * j + 4, 4, 4) for i in range(20) for j in range(6)]
    assert len(detections_from_mask(mask_with(*boxes), CAMERA)) == MAX_DETECTIONS


def test_bool_and_uint8_agree_and_empty_gives_none() -> None:
    mask = mask_with((100, 50, 20, 20))
    (one,), (other,) = detections_from_mask(mask, CAMERA), detections_from_mask(mask.astype(np.uint8) * 255, CAMERA)
    assert one.centre_px.tolist() == other.centre_px.tolist()
    assert detections_from_mask(mask_with(), CAMERA) == []


@pytest.mark.parametrize(
    "mask",
    [
        np.zeros((320, 240), np.uint8),
        np.zeros((240, 320, 1), np.uint8),
        np.zeros((240, 320), np.float32),
        np.zeros((120, 320), np.uint8),
        np.zeros((480, 640), np.uint8),
        np.zeros((0, 0), np.uint8),
    ],
    ids=lambda mask: f"{mask.dtype}{mask.shape}",
)
def test_wrong_mask_raises(mask: np.ndarray) -> None:
    with pytest.raises(ValueError, match="mask must be"):
        detections_from_mask(mask, CAMERA)


def test_pieces_joined_are_the_whole() -> None:
    camera = Camera(640, 360, 600.0, 600.0, 319.5, 179.5)
    mask = np.zeros((360, 640), np.uint8)
    mask[100:160, 200:300] = 1
    (whole,) = detections_from_mask(mask, camera)
    mask[:, 240:246] = 0
    one = joined(detections_from_mask(mask, camera))
    for name in ("centre_px", "width_px", "height_px", "touches_border"):
        assert np.all(getattr(one, name) == getattr(whole, name)), name
    assert one.area_px == 60 * 94
    rows, columns = np.nonzero(mask)
    assert one.covariance_px2 == pytest.approx(np.cov(np.stack([columns, rows]), bias=True), abs=0.5, rel=0.05)
    assert joined([whole]).covariance_px2 == pytest.approx(whole.covariance_px2)


def test_joined_has_the_lowest_foot_the_largest_doubt_and_any_border() -> None:
    high, low = detections_from_mask(mask_with((100, 50, 30, 20), (100, 80, 10, 10)), CAMERA)
    one = joined([high, low])
    assert one.base_px == pytest.approx(low.base_px) and low.base_px[1] > high.base_px[1]
    assert one.sigma_px == max(high.sigma_px, low.sigma_px) and not one.touches_border
    at_the_border, inside = detections_from_mask(mask_with((0, 50, 30, 20), (40, 50, 10, 10)), CAMERA)
    one = joined([inside, at_the_border])
    assert one.touches_border and one.is_cut == (True, False)
