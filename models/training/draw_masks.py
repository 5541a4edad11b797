"""Masks of smoke from rough outlines: `python models/training/draw_masks.py OUTLINES PICTURES` (see README.md here).

Writes a folder as `train.py --real` and `distloc study segmentation` read it: `images/` with the frames that were
outlined, and only those; `masks/`, 0 and 255; `sheets/`, where the masks can be checked by eye.
"""

import argparse
import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from distloc.types import FloatArray
from outlines import Outlined, OutlinesError, check_pictures, drawn_smoke, read_outlines
from refine import mask_from_outline
from service.commands.study.images import ImageFolderError, image_folders
from service.commands.study.segmentation.overlay import sheet, tile
from service.common.files import read_image, write_whole

_TILES, _SHEETS = 15, "sheets"  # on a sheet; their folder
_MARGIN = 0.35  # of the smoke's size, shown round it on a sheet
_LEAST_VIEW = 0.2  # of the frame, shown on a sheet


class NotOursError(Exception):
    """A folder that is not written to: one line that names it and says why."""


def draw_masks(outlines: Path, pictures: Path, out: Path) -> str:
    """Write images, masks and sheets under `out`, in place of those of an earlier run; what was written, in words.

    Raises OutlinesError, ImageFolderError or NotOursError before anything is written.
    """
    outlined = read_outlines(outlines)
    (folder,) = image_folders([pictures])
    files = {path.stem: path for path in folder.images}
    check_pictures(outlines, outlined, files)
    _make_folders(out, pictures)
    overlaps: list[float] = []
    for number, start in enumerate(range(0, len(outlined), _TILES), start=1):
        tiles = []
        for one in outlined[start : start + _TILES]:
            source = files[one.name]
            image = read_image(source)
            assert image is not None, source  # it was read when it was checked
            mask = mask_from_outline(image, one)
            shutil.copyfile(source, out / "images" / source.name)
            _write_png(out / "masks" / f"{one.name}.png", mask)
            tiles.append(_tile(image, one, mask))
            if one.has_smoke and one.name in folder.boxes:
                overlaps.append(box_overlap(mask, folder.boxes[one.name]))
        _write_png(out / "sheets" / f"sheet_{number:02}.png", sheet(tiles))
    said = f"{out}: {len(outlined)} masks, {sum(one.has_smoke for one in outlined)} with smoke"
    if overlaps:
        low, middle = np.quantile(overlaps, (0.1, 0.5))
        said += f"; bounding boxes and boxes.csv: IoU {middle:.2f} in the median, a tenth under {low:.2f}"
    return said


def box_overlap(mask: NDArray[np.uint8], boxes: FloatArray) -> float:
    """The IoU of a mask's bounding box with that of boxes (N, 4) of centre, width and height in shares of the image."""
    x, y, w, h = cv2.boundingRect(mask)
    size = np.array(mask.shape[::-1])
    low, high = (edge * size for edge in (boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, :2] + boxes[:, 2:] / 2))
    low, high = low.min(axis=0), high.max(axis=0)
    sides = np.minimum(high, (x + w, y + h)) - np.maximum(low, (x, y))
    shared = float(np.prod(np.maximum(sides, 0.0)))
    return shared / (w * h + float(np.prod(high - low)) - shared)


def _make_folders(out: Path, pictures: Path) -> None:
    """Empty folders for what is written; a mask whose outline is gone does not stay."""
    if pictures.resolve().is_relative_to(out.resolve()):
        raise NotOursError(f"{out}: holds the pictures that are read: name another folder with --out")
    if out.exists() and not (out.is_dir() and ((out / _SHEETS).is_dir() or not any(out.iterdir()))):
        raise NotOursError(f"{out}: was not written by this program, it has no {_SHEETS}/: name another with --out")
    for name in ("images", "masks", _SHEETS):
        if (out / name).exists():
            shutil.rmtree(out / name)
    for name in (_SHEETS, "images", "masks"):
        (out / name).mkdir(parents=True)


def _tile(image: NDArray[np.uint8], one: Outlined, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The part of the frame round its smoke; the outline green, the mask's edge magenta."""
    drawn = drawn_smoke(one, *mask.shape) * np.uint8(255)
    rows, columns = _view(drawn | mask)
    said = f"line {one.line}: " + (f"{100.0 * (mask > 0).mean():.2f} % smoke" if one.has_smoke else "no smoke")
    return tile(image[rows, columns], drawn[rows, columns], mask[rows, columns], one.name, said)


def _view(smoke: NDArray[np.uint8]) -> tuple[slice, slice]:
    """Rows and columns in the frame's proportions with the smoke in their middle; all of them where there is none."""
    height, width = smoke.shape
    if not smoke.any():
        return slice(0, height), slice(0, width)
    x, y, w, h = cv2.boundingRect(smoke)
    share = min(1.0, max(_LEAST_VIEW, (1.0 + _MARGIN) * max(w / width, h / height)))
    left = round(np.clip(x + w / 2 - share * width / 2, 0, (1.0 - share) * width))
    top = round(np.clip(y + h / 2 - share * height / 2, 0, (1.0 - share) * height))
    return slice(top, top + round(share * height)), slice(left, left + round(share * width))


def _write_png(path: Path, picture: NDArray[np.uint8]) -> None:
    _, data = cv2.imencode(".png", picture)
    write_whole(path, data.tobytes())


def main() -> int:
    """The command line; 1 where the outlines or the pictures are at fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("outlines", type=Path, help="the outlines' file; outlines.py says how it is written")
    parser.add_argument("pictures", type=Path, help="the folder of the frames, or with images/ in it")
    parser.add_argument("--out", type=Path, default=Path("build/smoke_hpwren_drawn"), help="default: %(default)s")
    plan = parser.parse_args()
    try:
        print(draw_masks(plan.outlines, plan.pictures, plan.out))
    except (OutlinesError, ImageFolderError, NotOursError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
