"""The review's drawings, as SVG: the mission's map, and how a fire's ellipse got smaller."""

import math
from collections.abc import Callable, Sequence
from html import escape

from service.ground.picture.views import FireView, News

_WIDTH, _HEIGHT, _MARGIN = 1060, 640, 50
_PLOT_WIDTH, _PLOT_HEIGHT = 700, 150
_METRES_A_DEGREE = 111_320.0
_LARGEST_M = 50_000.0

_Project = Callable[[float, float], tuple[float, float]]


def mission_map(news: News) -> str:
    """Fires with their ellipses and the drones' ways, north up, with a scale."""
    places = [(one.lat_deg, one.lon_deg) for one in news.fires if one.lat_deg is not None and one.lon_deg is not None]
    places += [(lat, lon) for drone in news.drones for lon, lat in drone.path]
    if not places:
        return "<p>No place is known.</p>"
    low = min(lat for lat, _ in places), min(lon for _, lon in places)
    high = max(lat for lat, _ in places), max(lon for _, lon in places)
    east_scale = math.cos(math.radians((low[0] + high[0]) / 2.0))
    north_m = max((high[0] - low[0]) * _METRES_A_DEGREE, 500.0)
    east_m = max((high[1] - low[1]) * _METRES_A_DEGREE * east_scale, 500.0)
    pixels = min((_WIDTH - 2 * _MARGIN) / east_m, (_HEIGHT - 2 * _MARGIN) / north_m)
    middle = (low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0

    def project(lat: float, lon: float) -> tuple[float, float]:
        x = _WIDTH / 2 + (lon - middle[1]) * _METRES_A_DEGREE * east_scale * pixels
        return x, _HEIGHT / 2 - (lat - middle[0]) * _METRES_A_DEGREE * pixels

    tracks = "".join(_track([project(lat, lon) for lon, lat in drone.path], drone.name) for drone in news.drones)
    fires = "".join(_fire(one, project, pixels) for one in news.fires)
    return _svg(_WIDTH, _HEIGHT, f"{tracks}{fires}{_scale(pixels)}", "Map of the mission, north up")


def size_plot(sizes: Sequence[tuple[float, float]], begin_s: float, end_s: float) -> str:
    """The ellipse's half-length in metres against time, logarithmic."""
    if len(sizes) < 2:
        return "<p class='quiet'>Reported once.</p>"
    logs = [math.log10(max(size, 1.0)) for _, size in sizes]
    low, high = math.floor(min(logs)), max(math.ceil(max(logs)), math.floor(min(logs)) + 1)
    span_s = max(end_s - begin_s, 1.0)

    def at(time_s: float, log: float) -> str:
        x = 60 + (time_s - begin_s) / span_s * (_PLOT_WIDTH - 80)
        return f"{x:.1f},{_PLOT_HEIGHT - 20 - (log - low) / (high - low) * (_PLOT_HEIGHT - 40):.1f}"

    marks = ""
    for power in range(low, high + 1):
        y = at(begin_s, power).partition(",")[2]
        marks += f"<line class='grid' x1='60' x2='{_PLOT_WIDTH - 20}' y1='{y}' y2='{y}'/>"
        marks += f"<text x='4' y='{y}'>{10**power} m</text>"
    points = " ".join(at(time_s, log) for (time_s, _), log in zip(sizes, logs, strict=True))
    return _svg(
        _PLOT_WIDTH, _PLOT_HEIGHT, f"{marks}<polyline class='line' points='{points}'/>", "Half-length over time"
    )


def _track(points: Sequence[tuple[float, float]], name: str) -> str:
    if not points:
        return ""
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    x, y = points[-1]
    return f"<polyline class='track' points='{line}'/><text x='{x + 6:.1f}' y='{y + 14:.1f}'>{escape(name)}</text>"


def _fire(fire: FireView, project: _Project, pixels: float) -> str:
    if fire.lat_deg is None or fire.lon_deg is None:
        return ""
    x, y = project(fire.lat_deg, fire.lon_deg)
    kind = "not_a_fire" if fire.mark is not None and fire.mark.verdict else fire.state
    shape, ring = fire.ellipse95, ""
    if None not in (shape.semi_major_m, shape.semi_minor_m, shape.azimuth_deg):
        major_m, minor_m = float(shape.semi_major_m or 0.0), float(shape.semi_minor_m or 0.0)
        if major_m < _LARGEST_M:
            ring = (
                f"<ellipse class='ring {kind}' rx='{major_m * pixels:.1f}' ry='{minor_m * pixels:.1f}' "
                f"transform='translate({x:.1f} {y:.1f}) rotate({(shape.azimuth_deg or 0.0) - 90.0:.1f})'/>"
            )
    symbol = f"<path class='{kind}' d='M{x:.1f} {y - 8:.1f}l8 14h-16Z'/>"
    return f"{ring}{symbol}<text x='{x + 11:.1f}' y='{y - 8:.1f}'>{escape(fire.id)}: {escape(kind)}</text>"


def _scale(pixels: float) -> str:
    length_m = 10.0 ** math.floor(math.log10(200.0 / pixels))
    length_m *= next(one for one in (5.0, 2.0, 1.0) if one * length_m * pixels <= 200.0)
    text = f"{length_m / 1000:g} km" if length_m >= 1000 else f"{length_m:g} m"
    y, width = _HEIGHT - 20, length_m * pixels
    return f"<path d='M20 {y}h{width:.1f}' stroke='#16191d' stroke-width='3'/><text x='20' y='{y - 8}'>{text}</text>"


def _svg(width: int, height: int, inside: str, title: str) -> str:
    return f"<svg viewBox='0 0 {width} {height}' width='{width}' role='img'><title>{title}</title>{inside}</svg>"
