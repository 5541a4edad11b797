"""Elevation models as Copernicus hands them out: cloud-optimised GeoTIFFs of a degree, written by tifffile."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

HeightsOf = Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]]
_KEYS = (1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326)  # geographic, pixel is area, WGS 84


def glo30_name(lat: int, lon: int) -> str:
    ns, ew = "NS"[lat < 0], "EW"[lon < 0]
    return f"Copernicus_DSM_COG_10_{ns}{abs(lat):02d}_00_{ew}{abs(lon):03d}_00_DEM.tif"


def glo30_pixels(lat: int, lon: int, rows: int, cols: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Latitudes (rows, 1) and longitudes (cols,) of the pixels' middles: the first is on the whole degree, the last
    is one short of the next: no two tiles share one."""
    return lat + 1.0 - np.arange(rows)[:, None] / rows, lon + np.arange(cols) / cols


def write_glo30(
    folder: Path,
    lat: int,
    lon: int,
    heights: NDArray[Any] | HeightsOf,
    rows: int = 3600,
    cols: int = 3600,
    block: int = 1024,
    overviews: int = 2,
) -> Path:
    """One tile: deflated with the predictor for floats, in square blocks, each overview half of the one before."""
    path = folder / glo30_name(lat, lon)
    numbers = heights(*glo30_pixels(lat, lon, rows, cols)) if callable(heights) else heights
    numbers = np.broadcast_to(np.asarray(numbers, np.float32), (rows, cols))
    half = np.array([0.5 / cols, 0.5 / rows])
    tags = [
        (33550, "d", 3, (1.0 / cols, 1.0 / rows, 0.0), True),
        (33922, "d", 6, (0.0, 0.0, 0.0, lon - half[0], lat + 1.0 + half[1], 0.0), True),
        (34735, "H", len(_KEYS), _KEYS, True),
    ]
    options: dict[str, Any] = dict(
        photometric="minisblack", metadata=None, tile=(block, block), predictor=3, compressionargs={"level": 1}
    )
    with tifffile.TiffWriter(path) as file:
        file.write(numbers, compression="adobe_deflate", extratags=tags, **options)
        for _ in range(overviews):
            numbers = numbers.reshape(len(numbers) // 2, 2, -1, 2).mean(axis=(1, 3)).astype(np.float32)
            file.write(numbers, compression="adobe_deflate", subfiletype=1, **options)
    return path
