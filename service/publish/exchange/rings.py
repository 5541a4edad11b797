"""Rings of longitude and latitude that maps draw, closed and counterclockwise as GeoJSON has them (RFC 7946)."""

import itertools
import math
from collections.abc import Iterable, Sequence

import numpy as np

from distloc.geometry.geodesy import LocalFrame
from distloc.types import Ellipse
from service.publish.parts import EllipseReport

Ring = list[tuple[float, float]]  # (lon, lat), the first again at its end

POINTS = 72
LARGEST_M = 200_000.0  # a semi-axis beyond that tells no place
_UNKNOWN = EllipseReport(semi_major_m=None, semi_minor_m=None, azimuth_deg=None)
_DIGITS = 7  # of a degree: a centimetre


def known_ellipse(told: EllipseReport) -> EllipseReport:
    """As told where it is an ellipse of a place's error; else one of which nothing is known.

    Its axes are over 0 in their order and at most `LARGEST_M`, its azimuth at most a turn. Every form goes by this.
    """
    major_m, minor_m, azimuth_deg = told.semi_major_m, told.semi_minor_m, told.azimuth_deg
    if major_m is None or minor_m is None or azimuth_deg is None or not abs(azimuth_deg) <= 360.0:
        return _UNKNOWN
    return told if 0.0 < minor_m <= major_m <= LARGEST_M else _UNKNOWN


def ellipse_ring(lat_deg: float, lon_deg: float, ellipse: EllipseReport, points: int = POINTS) -> Ring | None:
    """The ellipse about a place; None where its axes are not known, or no place's.

    Its area is the ellipse's: the corners lie a little outside of it, the middles of the sides inside.
    """
    one = known_ellipse(ellipse)
    if one.semi_major_m is None or one.semi_minor_m is None or one.azimuth_deg is None or abs(lat_deg) > 88.0:
        return None
    ellipse_m = Ellipse(one.semi_major_m, one.semi_minor_m, math.radians(one.azimuth_deg))
    return closed(around(ellipse_m, points), LocalFrame(lat_deg, lon_deg, 0.0))


def around(ellipse: Ellipse, points: int = POINTS) -> list[tuple[float, float, float]]:
    """Corners (east, north, 0) in metres from the ellipse's middle, counterclockwise, the first again at the end."""
    turn = np.linspace(0.0, 2.0 * np.pi, points + 1)
    step = 2.0 * math.pi / points
    wider = math.sqrt(step / math.sin(step))
    along, across = wider * ellipse.semi_major_m * np.cos(turn), wider * ellipse.semi_minor_m * np.sin(turn)
    sine, cosine = math.sin(ellipse.azimuth_rad), math.cos(ellipse.azimuth_rad)
    east, north = along * sine - across * cosine, along * cosine + across * sine
    return [(e, n, 0.0) for e, n in zip(east.tolist(), north.tolist(), strict=True)]


def closed(points_enu_m: Iterable[Sequence[float]], frame: LocalFrame) -> Ring:
    """The ring of points of a frame, of which the last is the first again."""
    places = [frame.geodetic_from_enu(np.array(point)) for point in points_enu_m]
    ring = [(round(lon, _DIGITS), round(lat, _DIGITS)) for lat, lon, _ in places]
    return [*ring[:-1], ring[0]]


def cut_at_antimeridian(ring: Ring) -> list[Ring]:
    """The ring, or its parts on either side of 180 degrees, each within -180 and 180 (RFC 7946, 3.1.9).

    For a convex ring; it holds no pole.
    """
    if all(abs(one[0] - other[0]) <= 180.0 for one, other in itertools.pairwise(ring)):
        return [ring]
    unwrapped = [ring[0]]
    for lon, lat in ring[1:]:
        before = unwrapped[-1][0]
        unwrapped.append((before + (lon - before + 180.0) % 360.0 - 180.0, lat))
    lons = [lon for lon, _ in unwrapped]
    edge = 180.0 if max(lons) > 180.0 else -180.0
    parts = []
    for sign in (1.0, -1.0):  # what lies west of the edge, then what lies east of it
        part = _half(unwrapped, edge, sign)
        if len(part) >= 4:
            moved = -math.copysign(360.0, edge) if sign * edge < 0.0 else 0.0
            parts.append([(round(lon + moved, _DIGITS), lat) for lon, lat in part])
    return parts


def _half(ring: Ring, edge: float, sign: float) -> Ring:
    """What of a convex ring has sign * (edge - lon) >= 0 (Sutherland and Hodgman, 1974), closed."""
    kept: Ring = []
    for (lon0, lat0), (lon1, lat1) in itertools.pairwise(ring):
        if sign * (edge - lon0) >= 0.0:
            kept.append((lon0, lat0))
        if (edge - lon0) * (edge - lon1) < 0.0:
            share = (edge - lon0) / (lon1 - lon0)
            kept.append((edge, round(lat0 + share * (lat1 - lat0), _DIGITS)))
    return [*kept, kept[0]] if kept else []
