"""The slope of a noisy series; the soak asks it whether memory grows. Free of I/O."""

import numpy as np

from distloc.types import FloatArray

_MOST_POINTS = 400  # 80,000 pairs


def theil_sen(x: FloatArray, y: FloatArray) -> float:
    """The median slope (units of y by units of x) of all pairs of points (N,); 0 for fewer than two.

    Theil 1950, Sen 1968: up to 29 % of wild points do not move it. Long series are first cut into bins, each replaced
    by its median.
    """
    kept = np.isfinite(x) & np.isfinite(y)
    x, y = x[kept], y[kept]
    if x.size > _MOST_POINTS:
        parts = np.array_split(np.arange(x.size), _MOST_POINTS)
        x = np.array([np.median(x[part]) for part in parts])
        y = np.array([np.median(y[part]) for part in parts])
    first, second = np.triu_indices(x.size, 1)
    dx = x[second] - x[first]
    apart = dx != 0.0
    return float(np.median((y[second] - y[first])[apart] / dx[apart])) if apart.any() else 0.0
