"""The land's fine texture, averaged over what a pixel covers: else it would shimmer with each metre of flight."""

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.simulation.landscape.texture import Floats, periodic

_TEXEL_M = 0.85
_N = 1024
_LEVELS = 6  # each of half as many texels as the one before, all below each other in one picture
_CELLS = (512, 128, 32)  # patches a side: 1.7, 7 and 27 m
_SAMPLES = 3  # along the view, where a pixel covers most
_AMPLITUDE = 0.16
_CANOPY = 2.0


class Detail:
    """Brightness that wood and open land add to 1, periodic over 870 m."""

    def __init__(self, rng: np.random.Generator) -> None:
        soil = np.sum([_noise(rng, cells) for cells in _CELLS], axis=0)
        wood = soil + _CANOPY * np.tile(_canopy(rng, _N // 2), (2, 2))
        level = (_AMPLITUDE * np.stack([wood, 0.6 * soil], axis=-1)).astype(np.float32)
        parts, self._first_row = [], np.zeros(_LEVELS, np.float32)
        for number in range(_LEVELS):
            part = periodic(level)
            parts.append(np.pad(part, ((0, 0), (0, _N + 1 - part.shape[1]), (0, 0))))
            if number + 1 < _LEVELS:
                self._first_row[number + 1] = self._first_row[number] + part.shape[0]
                level = level.reshape(level.shape[0] // 2, 2, -1, 2, 2).mean(axis=(1, 3))
        self._atlas = np.vstack(parts)

    def at(
        self, east_m: Floats, north_m: Floats, sine: Floats, cosine: Floats, across_m: Floats, along_m: Floats
    ) -> tuple[Floats, Floats]:
        """Of wood and of open land at places (R, C), seen along the azimuths `sine` and `cosine`, by pixels that cover
        `across_m` by `along_m`.
        """
        number = np.clip(np.rint(np.log2(across_m / np.float32(_TEXEL_M))), 0, _LEVELS - 1).astype(np.int32)
        size = np.ldexp(np.float32(_N), -number).astype(np.float32)
        scale, first = size / np.float32(_N * _TEXEL_M), self._first_row[number]
        total = np.zeros((*east_m.shape, 2), np.float32)
        for share in (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5:
            way_m = np.float32(share) * along_m
            x, y = (east_m + way_m * sine) * scale, (north_m + way_m * cosine) * scale
            x -= size * np.floor(x / size)
            y -= size * np.floor(y / size)
            total += cv2.remap(self._atlas, x, y + first, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        seen = np.clip(np.float32(1.7) - across_m / np.float32(_TEXEL_M * 2**_LEVELS), 0.0, 1.0) / _SAMPLES
        return total[..., 0] * seen, total[..., 1] * seen


def _noise(rng: np.random.Generator, cells: int) -> NDArray[np.float64]:
    """Periodic smooth noise (N, N) of unit variance with so many patches a side."""
    scale, edge = _N // cells, 2
    around = np.pad(rng.normal(size=(cells, cells)), edge, mode="wrap")
    large = cv2.resize(around, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    noise = large[edge * scale : edge * scale + _N, edge * scale : edge * scale + _N]
    return np.asarray(noise / noise.std())


def _canopy(rng: np.random.Generator, n: int) -> NDArray[np.float32]:
    """A forest from above (n, n): round crowns with a bright side and dark gaps, periodic, of unit variance."""
    picture = np.full((3 * n, 3 * n), -1.6, np.float32)
    count = n * n // 60
    places, radii, tints = rng.uniform(0.0, n, (count, 2)), rng.uniform(3.2, 6.2, count), rng.normal(0.0, 0.5, count)
    for place, radius, tint in zip(places, radii, tints, strict=True):
        ends = [[n + at, *([at] if at > n - 8 else []), *([2 * n + at] if at < 8 else [])] for at in place]
        for x in ends[0]:
            for y in ends[1]:
                for part, level in ((1.0, -0.35), (0.75, 0.35), (0.45, 0.9)):
                    shift = 0.35 * radius * (1.0 - part)
                    middle = (round(16.0 * (x - shift)), round(16.0 * (y + shift)))
                    cv2.circle(picture, middle, round(16.0 * part * radius), level + tint, -1, cv2.LINE_8, 4)
    tile = cv2.GaussianBlur(picture, (0, 0), 0.6)[n : 2 * n, n : 2 * n]
    return np.asarray((tile - tile.mean()) / tile.std())
