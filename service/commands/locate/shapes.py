"""The ring of longitude and latitude of each place: its ellipse, or the sector of a bearing. The writers share them."""

import math

import numpy as np

from distloc.batch.place import Located, Place
from distloc.batch.sighting import Sighting
from distloc.geometry.geodesy import LocalFrame
from service.publish.exchange.rings import Ring, around, closed

_FAR_M = 30_000.0  # a sector without an end is drawn so far


def outline(place: Place, located: Located, camera: Sighting) -> tuple[Ring, ...]:
    """Of a place its 95 % ellipse, of a bearing its sector."""
    if place.position_enu_m is not None and place.ellipse95 is not None:
        corners = [place.position_enu_m + np.array(corner) for corner in around(place.ellipse95)]
        return (closed(corners, located.frame),)
    frame = LocalFrame(camera.lat_deg, camera.lon_deg, camera.height_m)
    return tuple(_sector(place, part, frame) for part in place.bearing.parts95_m)


def _sector(place: Place, ranges_m: tuple[float, float], frame: LocalFrame) -> Ring:
    bearing = place.bearing
    low_m, high_m = ranges_m[0], ranges_m[1] if math.isfinite(ranges_m[1]) else max(_FAR_M, 1.5 * ranges_m[0])
    azimuths = bearing.azimuth_rad + np.linspace(-bearing.azimuth95_rad, bearing.azimuth95_rad, 13)
    arc = [(math.sin(a), math.cos(a), 0.0) for a in azimuths.tolist()]
    near = [(low_m * e, low_m * n, u) for e, n, u in arc]
    far = [(high_m * e, high_m * n, u) for e, n, u in reversed(arc)]
    return closed([*far, *near, far[0]], frame)  # counterclockwise
