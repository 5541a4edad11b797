"""How large the white errors are that nobody told: sizes that may be, and which of them the sightings leave.

Most tables have none. The headings of a drone's stills jump by 0.8 degrees from picture to picture, boxes about a plume
scatter by half a degree. To take that as a slow error makes the ellipse too small.
"""

import math

import numpy as np

from distloc.batch.chain import Chain, noise_of
from distloc.batch.lines import Lines
from distloc.types import FloatArray

Scale = tuple[float, float]  # how far the heading jumps, and how far all scatters, one standard deviation in radians

_HEADING_SHARES = {0.0: 0.4, 0.4: 0.25, 0.8: 0.2, 1.6: 0.15}  # by degrees: before anything is seen
_SCATTER_SHARES = {0.0: 0.6, 0.2: 0.3, 0.6: 0.1}
_LOG_SHARES = {
    (math.radians(heading_deg), math.radians(scatter_deg)): math.log(heading_share * scatter_share)
    for heading_deg, heading_share in _HEADING_SHARES.items()
    for scatter_deg, scatter_share in _SCATTER_SHARES.items()
}
SCALES = tuple(_LOG_SHARES)

_WORTH = 4.0  # a logarithm by which a size may be less likely than the best
_MOST_SCALES = 4
_ENOUGH = 400  # sightings that tell


def likely_scales(lines: Lines, point_enu_m: FloatArray) -> list[Scale]:
    """The sizes that the lines' residuals at one point (3,) leave, at most four."""
    n = len(lines)
    chosen = np.zeros(n, np.bool_)
    chosen[np.unique(np.linspace(0, n - 1, min(n, _ENOUGH)).astype(np.intp))] = True
    some = lines.of(chosen)
    range_m, residuals = some.ranges_m(point_enu_m[None])[:, 0], some.residuals(point_enu_m[None])
    logs = {}
    for scale in SCALES:
        if scale[0] > 0.0 and lines.is_heading_told.all():
            continue
        chain = Chain(some, noise_of(some, *scale, range_m=range_m))
        squares = float(np.square(chain.whitened(residuals)).sum())
        logs[scale] = -0.5 * squares - 0.5 * chain.log_determinant + log_share(scale)
    ordered = sorted(logs, key=lambda scale: (-logs[scale], scale))
    kept = [scale for scale in ordered if logs[scale] > logs[ordered[0]] - _WORTH]
    return kept[: 1 if n > _ENOUGH else _MOST_SCALES]


def log_share(scale: Scale) -> float:
    """The log of how likely such white errors are before anything is seen."""
    return _LOG_SHARES[scale]
