"""Outlines of smoke drawn by hand, read from a text file and checked against the pictures; `draw_masks.py` calls it.

The file has one statement a line; blank lines and what follows `#` are left out:

    frame NAME            the picture's name without its suffix; what follows is in it
    smoke x,y x,y x,y     a rough polygon round smoke, in the picture's pixels
    clear x,y x,y x,y     a polygon in which there surely is none
    none                  the frame shows no smoke
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from service.common.files import FileRefusedError, check_file, read_image

SMOKE, CLEAR = "smoke", "clear"
_MOST_BYTES = 4_000_000
_LEAST_POINTS = 3
_POINT = re.compile(r"(-?\d{1,6}),(-?\d{1,6})", re.ASCII)
_STATEMENTS = f"frame NAME, {SMOKE} x,y ..., {CLEAR} x,y ... or none"


class OutlinesError(Exception):
    """What is wrong with a file of outlines: a line for each fault, that names the file and its line."""


@dataclass(frozen=True, slots=True)
class Polygon:
    """Corners (N, 2) int32 as (x, y), of smoke or of what surely is none, and the file's line."""

    kind: str
    corners_px: NDArray[np.int32]
    line: int


@dataclass(frozen=True, slots=True)
class Outlined:
    """A frame's name, the polygons drawn in it, and the line on which it begins; none of smoke: it shows none."""

    name: str
    polygons: tuple[Polygon, ...]
    line: int

    @property
    def has_smoke(self) -> bool:
        """Whether any was drawn."""
        return any(one.kind == SMOKE for one in self.polygons)


class _Draft:
    """A frame while its lines are read."""

    def __init__(self, name: str, line: int) -> None:
        self.name, self.line, self.is_none = name, line, False
        self.polygons: list[Polygon] = []

    def take(self, word: str, rest: str, line: int) -> str | None:
        """Take one of the frame's lines; what is wrong with it, if anything."""
        if word == "none":
            self.is_none = True
            return "none stands alone, without points" if rest else None
        if word not in (SMOKE, CLEAR):
            return f"{word!r} is no statement: {_STATEMENTS}"
        matches = [(text, _POINT.fullmatch(text)) for text in rest.split()]
        wrong = [text for text, match in matches if match is None]
        if wrong:
            return f"{wrong[0]!r} is no point: x,y in whole pixels, without a space"
        if len(matches) < _LEAST_POINTS:
            return f"{len(matches)} points: a polygon has {_LEAST_POINTS} or more"
        corners = np.array([[int(match[1]), int(match[2])] for _, match in matches if match], dtype=np.int32)
        self.polygons.append(Polygon(word, corners, line))
        return None

    def fault(self) -> str | None:
        """What its lines leave out or contradict."""
        has_smoke = any(one.kind == SMOKE for one in self.polygons)
        if self.is_none and has_smoke:
            return f"{self.name}: has both smoke and none: leave one out"
        if not self.is_none and not has_smoke:
            return f"{self.name}: has neither smoke nor none: add a polygon, or none where no smoke is seen"
        return None


def read_outlines(path: Path) -> list[Outlined]:
    """The frames in the file's order; raises OutlinesError with a line for each fault of the file."""
    drafts: dict[str, _Draft] = {}
    faults: list[tuple[int, str]] = []
    draft: _Draft | None = None
    for number, text in enumerate(_lines(path), start=1):
        word, _, rest = text.partition("#")[0].strip().partition(" ")
        rest = rest.strip()
        fault = None
        if word == "frame":
            draft = _Draft(rest, number)
            if not rest:
                fault = "a frame without a name: frame NAME"
            elif rest in drafts:
                fault = f"{rest}: already on line {drafts[rest].line}: keep one of the two"
            else:
                drafts[rest] = draft
        elif word:
            fault = "comes before the first frame: begin with frame NAME" if draft is None else None
            fault = fault if draft is None else draft.take(word, rest, number)
        if fault is not None:
            faults.append((number, fault))
    if not faults:  # a line that was not understood would be missed in its frame, too
        faults = [(one.line, fault) for one in drafts.values() if (fault := one.fault()) is not None]
    _raise_all(path, faults)
    if not drafts:
        raise OutlinesError(f"{path}: has no frame: {_STATEMENTS}")
    return [Outlined(one.name, tuple(one.polygons), one.line) for one in drafts.values()]


def check_pictures(path: Path, outlined: Sequence[Outlined], files: Mapping[str, Path]) -> None:
    """Raise OutlinesError with a line for each frame that does not fit its picture; `path` is the outlines' file.

    It has no picture in `files`, by name, one that cannot be read, a point off it, or smoke that covers no pixel. A
    point may lie on the far edges: x from 0 to the width, y from 0 to the height.
    """
    _raise_all(path, [fault for one in outlined for fault in _faults_in_picture(one, files)])


def drawn_smoke(outlined: Outlined, height: int, width: int) -> NDArray[np.uint8]:
    """1 in (H, W) where smoke was drawn and not cut away as clear, else 0."""
    return _filled(outlined, SMOKE, height, width) & (1 - _filled(outlined, CLEAR, height, width))


def drawn_clear(outlined: Outlined, height: int, width: int) -> NDArray[np.uint8]:
    """1 in (H, W) where it was drawn that there is no smoke, else 0."""
    return _filled(outlined, CLEAR, height, width)


def _faults_in_picture(one: Outlined, files: Mapping[str, Path]) -> list[tuple[int, str]]:
    if one.name not in files:
        return [(one.line, f"{one.name}: none of the {len(files)} pictures has that name (it goes without the suffix)")]
    image = read_image(files[one.name])
    if image is None:
        return [(one.line, f"{files[one.name]}: cannot be read: give a PNG or JPEG")]
    height, width = image.shape[:2]
    off = [(polygon.line, fault) for polygon in one.polygons if (fault := _off(polygon, width, height))]
    if one.has_smoke and not off and not drawn_smoke(one, height, width).any():
        return [(one.line, f"{one.name}: its smoke covers no pixel: all of it is clear or on the far edge")]
    return off


def _off(polygon: Polygon, width: int, height: int) -> str | None:
    """Which of its corners lies off the picture, and where they may lie."""
    off = [(x, y) for x, y in polygon.corners_px.tolist() if not (0 <= x <= width and 0 <= y <= height)]
    return f"{off[0][0]},{off[0][1]} is off the frame: x is 0 to {width}, y 0 to {height}" if off else None


def _filled(outlined: Outlined, kind: str, height: int, width: int) -> NDArray[np.uint8]:
    """1 inside polygons of a kind, their edges included; filled one by one, so that an overlap is inside as well."""
    plane = np.zeros((height, width), np.uint8)
    for one in outlined.polygons:
        if one.kind == kind:
            cv2.fillPoly(plane, [one.corners_px], 1)
    return plane


def _lines(path: Path) -> list[str]:
    try:
        check_file(path, most_bytes=_MOST_BYTES)
        return path.read_text(encoding="utf-8").splitlines()
    except FileRefusedError as error:
        raise OutlinesError(str(error)) from error
    except (OSError, ValueError) as error:
        raise OutlinesError(f"{path}: cannot be read: {error}") from error


def _raise_all(path: Path, faults: Sequence[tuple[int, str]]) -> None:
    if faults:
        raise OutlinesError("\n".join(f"{path}:{line}: {fault}" for line, fault in faults))
