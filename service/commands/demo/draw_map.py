"""The demo's map: the flight, the particles, both 95 % ellipses and the truth, drawn with OpenCV."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.types import Ellipse, FloatArray

_WIDTH, _HEIGHT, _MARGIN = 1200, 900, 70
_INK, _GREY, _LIGHT = (40, 40, 40), (130, 130, 130), (225, 225, 225)
_PATH, _PARTICLE, _ELLIPSE, _TRUTH = (180, 90, 20), (80, 180, 250), (40, 40, 220), (30, 140, 30)
_BLIND = (150, 50, 140)


class MapPicture:
    """A picture in metres east and north, fitted around the points (2, N) that it must show; `size` in pixels."""

    def __init__(self, must_show_en_m: FloatArray, size: tuple[int, int] = (_WIDTH, _HEIGHT)) -> None:
        self._size = size
        low, high = must_show_en_m.min(axis=1), must_show_en_m.max(axis=1)
        span = np.maximum(high - low, 100.0) * 1.1
        self._scale = float(min((size[0] - 2 * _MARGIN) / span[0], (size[1] - 2 * _MARGIN) / span[1]))
        self._centre = (low + high) / 2
        self.image: NDArray[np.uint8] = np.full((size[1], size[0], 3), 250, np.uint8)
        self._grid()

    def _pixels(self, points_en_m: FloatArray) -> NDArray[np.int32]:
        offset = (points_en_m.T - self._centre) * self._scale
        pixels = np.stack([self._size[0] / 2 + offset[:, 0], self._size[1] / 2 - offset[:, 1]], axis=1)
        return np.asarray(np.rint(pixels), dtype=np.int32)

    def _grid(self) -> None:
        step = next(s for s in (5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 50000) if s * self._scale >= 70)
        half = np.array(self._size) / 2 / self._scale
        low, high = self._centre - half, self._centre + half
        for axis in (0, 1):
            for value in np.arange(np.ceil(low[axis] / step), high[axis] / step) * step:
                ends = np.array([low, high]).T.copy()
                ends[axis] = value
                a, b = self._pixels(ends)
                cv2.line(self.image, tuple(map(int, a)), tuple(map(int, b)), _LIGHT, 1)
        y = self._size[1] - 30
        cv2.line(self.image, (40, y), (40 + round(step * self._scale), y), _INK, 3)
        self._text(f"{step} m", (40, y - 10))
        x = self._size[0] - 40
        cv2.arrowedLine(self.image, (x, 90), (x, 35), _INK, 2, cv2.LINE_AA, tipLength=0.3)
        self._text("N", (x - 7, 112))

    def _text(self, text: str, at: tuple[int, int], colour: tuple[int, int, int] = _INK, size: float = 0.6) -> None:
        cv2.putText(self.image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)

    def particles(self, points_en_m: FloatArray) -> None:
        """Points (2, N), darker where they are denser."""
        pixels = self._pixels(points_en_m)
        inside = ((pixels >= 0) & (pixels < self._size)).all(axis=1)
        counts: NDArray[np.float32] = np.zeros((self._size[1], self._size[0]), np.float32)
        np.add.at(counts, (pixels[inside, 1], pixels[inside, 0]), 1.0)
        counts = np.asarray(cv2.blur(counts, (3, 3)), np.float32)  # a dot of 3 x 3 pixels each
        share = np.sqrt(counts / max(float(counts.max()), 1.0))[:, :, None]
        share = np.where(share > 0, 0.35 + 0.65 * share, 0.0)
        self.image[:] = (self.image * (1 - share) + np.array(_PARTICLE) * share).astype(np.uint8)

    def path(self, points_en_m: FloatArray) -> None:
        """The camera's way (2, N), with a dot where it is now."""
        pixels = self._pixels(points_en_m)
        cv2.polylines(self.image, [pixels.reshape(-1, 1, 2)], False, _PATH, 2, cv2.LINE_AA)
        cv2.circle(self.image, tuple(map(int, pixels[-1])), 6, _PATH, -1, cv2.LINE_AA)

    def ellipse(self, centre_en_m: FloatArray, ellipse: Ellipse, *, is_blind: bool = False) -> None:
        """A 95 % ellipse and its centre, the calibrated filter's or the bias-blind one's."""
        colour = _BLIND if is_blind else _ELLIPSE
        angle = np.linspace(0, 2 * np.pi, 181)
        along = np.array([np.sin(ellipse.azimuth_rad), np.cos(ellipse.azimuth_rad)])
        across = np.array([along[1], -along[0]])
        points = (
            centre_en_m[:, None]
            + along[:, None] * ellipse.semi_major_m * np.cos(angle)
            + across[:, None] * ellipse.semi_minor_m * np.sin(angle)
        )
        cv2.polylines(self.image, [self._pixels(points).reshape(-1, 1, 2)], True, colour, 2, cv2.LINE_AA)
        at = tuple(map(int, self._pixels(centre_en_m[:, None])[0]))
        cv2.drawMarker(self.image, at, colour, cv2.MARKER_CROSS, 18, 2, cv2.LINE_AA)

    def truth(self, point_en_m: FloatArray) -> None:
        """Where the fire really is."""
        at = tuple(map(int, self._pixels(point_en_m[:, None])[0]))
        cv2.drawMarker(self.image, at, _TRUTH, cv2.MARKER_TILTED_CROSS, 18, 3, cv2.LINE_AA)

    def legend(self, title: str) -> None:
        """The title and what each colour is."""
        self._text(title, (20, 32), size=0.7)
        names = {
            "flight path": _PATH,
            "particles": _PARTICLE,
            "calibrated 95 %: allows for a compass and a mount that are wrong": _ELLIPSE,
            "bias-blind 95 %: the same filter, taking heading and tilt as exact": _BLIND,
            "truth": _TRUTH,
        }
        for row, (name, colour) in enumerate(names.items()):
            cv2.rectangle(self.image, (20, 52 + row * 26), (38, 66 + row * 26), colour, -1)
            self._text(name, (48, 66 + row * 26), _GREY)

    def inset(self, other: "MapPicture", points_en_m: FloatArray, title: str) -> None:
        """Put another picture with a frame near the bottom, if none of the points (2, N) here is under it."""
        width, height = other._size
        left, top = (self._size[0] - width) // 2 - 60, self._size[1] - height - 20
        pixels = self._pixels(points_en_m)
        if ((pixels >= (left, top)) & (pixels < (left + width, top + height))).all(axis=1).any():
            return
        self.image[top : top + height, left : left + width] = other.image
        cv2.rectangle(self.image, (left, top), (left + width, top + height), _GREY, 1)
        self._text(title, (left + 12, top + 24))

    def write(self, path: Path) -> None:
        """Encode as PNG."""
        path.write_bytes(cv2.imencode(".png", self.image)[1].tobytes())
