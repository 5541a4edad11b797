"""Masks of smoke from rough outlines: `python models/training/draw_masks.py OUTLINES PICTURES` (see README.md here).

Writes a folder as `train.py --real` and `distloc study segmentation` read it: `images/` with the frames that were
outlined, and only those; `masks/`, 0 and 255; `sheets/`, where the masks can be checked by eye.
"""

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from outlines import CLEAR, SMOKE, Outlined, OutlinesError, read_outlines, read_pictures
from service.commands.study.draw_overlay import sheet, tile
from service.commands.study.images import ImageFolderError, image_folders
from service.common.files import write_whole

_INSIDE, _OUTSIDE = 0.01, 0.006  # of the width: how far within and without the outline its true course may lie
_SURE_SHARE = 0.5  # of half a part's thickness: what lies deeper is smoke, so that a thin base is not lost
_SURROUNDINGS = 0.08  # of the width: what is round the smoke tells what no smoke looks like
_ROUNDS = 4  # of GrabCut
_TILES = 15  # on a sheet
_MARGIN = 0.35  # of the smoke's size, shown round it on a sheet
_LEAST_VIEW = 0.2  # of the frame, shown on a sheet


def mask_from_outline(image: NDArray[np.uint8], outlined: Outlined) -> NDArray[np.uint8]:
    """Where the smoke of a BGR image (H, W, 3) is, 255 in (H, W), else 0: the outline, its edge found by GrabCut.

    The edge moves within a band along the outline only, and never into a part that was drawn as clear.
    """
    drawn = _filled(image.shape[:2], outlined.of_kind(SMOKE))
    clear = _filled(image.shape[:2], outlined.of_kind(CLEAR)) > 0
    drawn[clear] = 0
    if not drawn.any():
        return drawn
    labels = _labels(drawn, image.shape[1])
    labels[clear] = cv2.GC_BGD
    view = _surroundings(drawn, image.shape[1])
    part = labels[view].copy()
    smooth = cv2.GaussianBlur(image[view], (0, 0), 1.0)
    if (part == cv2.GC_BGD).any() and (part == cv2.GC_FGD).any():
        cv2.setRNGSeed(0)  # GrabCut's clusters begin at random
        cv2.grabCut(smooth, part, None, np.zeros((1, 65)), np.zeros((1, 65)), _ROUNDS, cv2.GC_INIT_WITH_MASK)
    is_smoke = np.isin(part, (cv2.GC_FGD, cv2.GC_PR_FGD))
    mask = np.zeros_like(drawn)
    mask[view] = np.where(is_smoke, 255, 0)
    calm = cv2.medianBlur(mask, 5)  # no single pixels along the edge
    return np.where(labels == cv2.GC_FGD, 255, np.where(labels == cv2.GC_BGD, 0, calm)).astype(np.uint8)


def draw_masks(outlines: Path, pictures: Path, out: Path) -> str:
    """Write images, masks and sheets under `out`, in place of those there; what was written, in one line.

    Raises OutlinesError or ImageFolderError, before anything is written.
    """
    outlined = read_outlines(outlines)
    (folder,) = image_folders([pictures])
    found = read_pictures(outlines, outlined, {path.stem: path for path in folder.images})
    files = {path.stem: path for path in folder.images}
    for name in ("images", "masks", "sheets"):
        if (out / name).exists():  # a mask whose outline is gone would stay
            shutil.rmtree(out / name)
        (out / name).mkdir(parents=True)
    tiles = []
    for one, image in found:
        mask = mask_from_outline(image, one)
        shutil.copyfile(files[one.name], out / "images" / files[one.name].name)
        _write_png(out / "masks" / f"{one.name}.png", mask)
        tiles.append(_tile(image, one, mask))
    for number, start in enumerate(range(0, len(tiles), _TILES), start=1):
        _write_png(out / "sheets" / f"sheet_{number:02}.png", sheet(tiles[start : start + _TILES]))
    smoky = sum(bool(one.of_kind(SMOKE)) for one in outlined)
    return f"{out}: {len(found)} masks, {smoky} with smoke"


def _filled(size: tuple[int, ...], polygons: Sequence[NDArray[np.int32]]) -> NDArray[np.uint8]:
    """1 inside the polygons, their edges included, else 0; one by one, as where two overlap is inside as well."""
    plane = np.zeros(size, np.uint8)
    for corners in polygons:
        cv2.fillPoly(plane, [corners], 1)
    return plane


def _labels(drawn: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """GrabCut's labels (H, W): sure beyond the band along the outline, open within it."""
    within = cv2.distanceTransform(drawn, cv2.DIST_L2, 5)
    without = cv2.distanceTransform(1 - drawn, cv2.DIST_L2, 5)
    is_sure = within >= np.minimum(max(2.0, _INSIDE * width), _SURE_SHARE * _half_thickness(drawn, within))
    is_open = without <= max(2.0, _OUTSIDE * width)
    open_label = np.where(drawn > 0, cv2.GC_PR_FGD, np.where(is_open, cv2.GC_PR_BGD, cv2.GC_BGD))
    return np.where((drawn > 0) & is_sure, cv2.GC_FGD, open_label).astype(np.uint8)


def _half_thickness(drawn: NDArray[np.uint8], within: NDArray[np.float32]) -> NDArray[np.float32]:
    """For each pixel drawn the radius of the largest disc drawn that covers it, in pixels."""
    radius = np.where(drawn > 0, 1.0, 0.0).astype(np.float32)
    for size in range(2, int(within.max()) + 1):
        core = (within >= size).astype(np.uint8)
        covered = cv2.distanceTransform(1 - core, cv2.DIST_L2, 5) < size
        radius[covered & (drawn > 0)] = size
    return radius


def _surroundings(drawn: NDArray[np.uint8], width: int) -> tuple[slice, slice]:
    """The rows and columns of the smoke and what is round it."""
    x, y, w, h = cv2.boundingRect(drawn)
    margin = round(_SURROUNDINGS * width)
    return slice(max(0, y - margin), y + h + margin), slice(max(0, x - margin), x + w + margin)


def _tile(image: NDArray[np.uint8], one: Outlined, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The part of the frame round its smoke; the outline green, the mask's edge magenta."""
    drawn = _filled(mask.shape, one.of_kind(SMOKE)) * np.uint8(255)
    rows, columns = _view(drawn | mask)
    said = f"line {one.line}: " + (f"{100.0 * (mask > 0).mean():.2f} % smoke" if one.of_kind(SMOKE) else "no smoke")
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
    except (OutlinesError, ImageFolderError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
