"""How large the white errors may be that nobody told, and how likely each size is before anything is seen.

Most tables have none. The headings of a drone's stills jump by 0.8 degrees from picture to picture, boxes about a plume
scatter by half a degree. To take that as a slow error makes the ellipse too small.
"""

import math

Scale = tuple[float, float]  # how far the heading jumps, and how far all scatters, one standard deviation in radians

_HEADING_SHARES = {0.0: 0.4, 0.4: 0.25, 0.8: 0.2, 1.6: 0.15}  # by degrees: before anything is seen
_SCATTER_SHARES = {0.0: 0.6, 0.2: 0.3, 0.6: 0.1}
_LOG_SHARES = {
    (math.radians(heading_deg), math.radians(scatter_deg)): math.log(heading_share * scatter_share)
    for heading_deg, heading_share in _HEADING_SHARES.items()
    for scatter_deg, scatter_share in _SCATTER_SHARES.items()
}
SCALES = tuple(_LOG_SHARES)


def log_share(scale: Scale) -> float:
    """The log of how likely such white errors are before anything is seen."""
    return _LOG_SHARES[scale]
