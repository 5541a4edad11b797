"""Rings of longitude and latitude that maps draw: an ellipse, the sector of a bearing. The writers share them."""

import math

import numpy as np

from distloc.batch.place import Located, Place
from distloc.batch.sighting import Sighting
from distloc.geometry.geodesy import LocalFrame

Ring = list[tuple[float, float]]  # (lon, lat), the first again at its end

_POINTS = 72
_FAR_M = 30_000.0  # a sector without an end is drawn so far


def outline(place: Place, located: Located, camera: Sighting) -> tuple[Ring, ...]:
    """Of a place its 95 % ellipse, of a bearing its sector."""
    if place.position_enu_m is not None and place.ellipse95 is not None:
        one, frame = place.ellipse95, located.frame
        turn = np.linspace(0.0, 2.0 * np.pi, _POINTS + 1)
        along = one.semi_major_m * np.cos(turn)
        across = one.semi_minor_m * np.sin(turn)
        sine, cosine = math.sin(one.azimuth_rad), math.cos(one.azimuth_rad)
        east, north = along * sine + across * cosine, along * cosine - across * sine
        middle = place.position_enu_m
        return (_closed([(middle[0] + e, middle[1] + n, middle[2]) for e, n in zip(east, north, strict=True)], frame),)
    frame = LocalFrame(camera.lat_deg, camera.lon_deg, camera.height_m)
    return tuple(_sector(place, part, frame) for part in place.bearing.parts95_m)


def _sector(place: Place, ranges_m: tuple[float, float], frame: LocalFrame) -> Ring:
    bearing = place.bearing
    low_m, high_m = ranges_m[0], ranges_m[1] if math.isfinite(ranges_m[1]) else max(_FAR_M, 1.5 * ranges_m[0])
    azimuths = bearing.azimuth_rad + np.linspace(-bearing.azimuth95_rad, bearing.azimuth95_rad, 13)
    arc = [(math.sin(a), math.cos(a), 0.0) for a in azimuths.tolist()]
    near = [(low_m * e, low_m * n, u) for e, n, u in arc]
    far = [(high_m * e, high_m * n, u) for e, n, u in reversed(arc)]
    return _closed([*near, *far, near[0]], frame)


def _closed(points_enu_m: list[tuple[float, float, float]], frame: LocalFrame) -> Ring:
    places = [frame.geodetic_from_enu(np.array(point)) for point in points_enu_m]
    ring = [(round(lon, 7), round(lat, 7)) for lat, lon, _ in places]
    return [*ring[:-1], ring[0]]
