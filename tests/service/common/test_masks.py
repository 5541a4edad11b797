"""Masks of every kind mean the same, lie as their image lies, and are refused where that can't be known."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from service.common.files import FileRefusedError
from service.common.image_header import turned
from service.common.masks import MaskFolder, misnamed
from tests.support.odd_pictures import REFUSED, with_orientation

STEP = np.tri(9, 16, dtype=np.uint8)


def masks(folder: Path, values: dict[str, NDArray[Any]]) -> MaskFolder:
    folder.mkdir(exist_ok=True)
    for name, one in values.items():
        assert cv2.imwrite(str(folder / f"{name}.png"), one)
    return MaskFolder(folder, 10_000)


def smoke(held: MaskFolder, name: str, orientation: int = 1, shape: tuple[int, int] = (9, 16)) -> NDArray[np.bool_]:
    return held.smoke(name, orientation, lambda mask: mask.shape == shape).region


@pytest.mark.parametrize(
    "values",
    [
        STEP,
        STEP * 255,
        STEP * 128,
        STEP.astype(np.uint16),
        STEP.astype(np.uint16) * 255,
        STEP.astype(np.uint16) * 65_535,
        STEP[..., None] * np.array([0, 0, 1], np.uint8),
        STEP[..., None] * np.array([0, 0, 128], np.uint8),  # as the second colour of a usual palette
        np.dstack([STEP * 255] * 3 + [np.full_like(STEP, 255)]),
        np.dstack([np.full_like(STEP, 255)] * 3 + [STEP * 255]),  # white, and cut out by transparency
    ],
    ids=["1", "255", "128", "1 of 16 bits", "255 of 16", "65535", "1 in red", "palette", "alpha", "cut out"],
)
def test_one_meaning(tmp_path: Path, values: NDArray[Any]) -> None:
    held = masks(tmp_path / "masks", {"a": values, "none": STEP * 0})
    assert np.array_equal(smoke(held, "a.jpg"), STEP > 0) and not smoke(held, "none").any()


def test_half_of_255_is_where_smoke_begins(tmp_path: Path) -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    held = masks(tmp_path / "masks", {"soft": levels, "faint": levels // 3, "ones": (levels > 99).astype(np.uint8)})
    assert np.array_equal(smoke(held, "soft", shape=(16, 16)), levels > 127)
    for name in ("faint", "ones"):  # beside masks of 255, 1 is no smoke, and told
        found = held.smoke(name, 1, lambda mask: True)
        assert found.is_faint and not found.region.any()


@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_a_mask_lies_as_its_image_whichever_way_it_was_drawn(tmp_path: Path, orientation: int) -> None:
    upright = turned(STEP, orientation)
    held = masks(tmp_path / "masks", {"raw": STEP * 255, "shown": upright * 255, "other": STEP[:, :5]})
    (tmp_path / "masks" / "own.png").write_bytes(with_orientation(STEP * 255, "PNG", orientation))
    for name in ("raw", "shown", "own"):
        assert np.array_equal(smoke(held, name, orientation, (16, 9)), upright > 0)
    with pytest.raises(FileRefusedError, match=r"other\.png: is 5 x 9 pixels, which does not fit its image"):
        smoke(held, "other", orientation, (16, 9))


@pytest.mark.parametrize("orientation", [2, 3, 4])
def test_a_mask_that_may_lie_either_way_is_refused_where_it_matters(tmp_path: Path, orientation: int) -> None:
    held = masks(tmp_path / "masks", {"a": STEP * 255, "even": np.full_like(STEP, 255), "none": STEP * 0})
    (tmp_path / "masks" / "own.png").write_bytes(with_orientation(STEP * 255, "PNG", orientation))
    with pytest.raises(FileRefusedError, match=rf"a\.png: its image is turned by EXIF \({orientation}\)"):
        smoke(held, "a", orientation)
    assert smoke(held, "even", orientation).all() and not smoke(held, "none", orientation).any()
    assert np.array_equal(smoke(held, "own", orientation), turned(STEP, orientation) > 0)


@pytest.mark.parametrize("name", [name for name, odd in REFUSED.items() if odd[0] == ".png" and "16 bits" not in name])
def test_a_mask_that_cannot_be_used_is_one_line(tmp_path: Path, name: str) -> None:
    held = masks(tmp_path / "masks", {"good": STEP * 255})
    (tmp_path / "masks" / "bad.png").write_bytes(REFUSED[name][1]())
    with pytest.raises(FileRefusedError, match=r"masks/bad\.png: ") as refused:
        smoke(held, "bad")
    assert "\n" not in str(refused.value)
    assert smoke(held, "good").any()


def test_black_on_nothing_is_refused(tmp_path: Path) -> None:
    held = masks(tmp_path / "masks", {"a": np.dstack([STEP * 0] * 3 + [STEP * 255])})
    with pytest.raises(FileRefusedError, match="nothing but transparency"):
        smoke(held, "a")


def test_masks_of_which_none_is_an_images_are_told(tmp_path: Path) -> None:
    masks(tmp_path / "masks", {"a_mask": STEP, "b_mask": STEP})
    assert misnamed(tmp_path / "masks", ["a.jpg", "b.jpg"]).endswith(
        "none of its 2 files (a_mask.png ...) is the mask of an image: that of a is a.png"
    )
    assert misnamed(tmp_path / "masks", ["b_mask.tif", "c.jpg"]) == "" and misnamed(tmp_path / "masks", []) == ""
    (tmp_path / "empty").mkdir()
    assert "is empty" in misnamed(tmp_path / "empty", ["a.jpg"])
    (tmp_path / "empty" / "a.jpg").touch()
    assert "that of a is a.png" in misnamed(tmp_path / "empty", ["a.jpg"])
