"""Cursor on Target events, version 2.0, of fires and drones: bytes of XML. Pure; the board says when.

Sizes: `ce` and `le` are one standard deviation (CE90 / 2.146, LE90 / 1.645), 9999999 where not known. `hae` is above
the ellipsoid. The region goes out as a closed polygon (`u-d-f`): an ellipse's `major` is a diameter to one reader and a
semi-axis to another. What ATAK does with them is in docs/tak.md.
"""

from collections.abc import Mapping
from html import escape  # of XML's as well; xml.sax would load urllib

from distloc.filter.uncertainty import NORMAL90
from service.common.shown import shown
from service.publish.exchange.drone import SharedDrone, drone_uid
from service.publish.exchange.fire import SharedFire
from service.publish.exchange.rings import ellipse_ring
from service.publish.parts import ViewReport
from service.publish.wire import utc_text

FIRE, SMOKE, DRONE, REGION, DELETE = "a-u-X-i-f-w", "a-u-X-i-f-s", "a-f-A-M-H-Q", "u-d-f", "t-x-d-d"
UNKNOWN = 9_999_999.0
RAYLEIGH90 = 2.146  # the circle that holds 90 % of a round normal error, in standard deviations
CORNERS = 18  # of a region: with them it fits one datagram of Ethernet
_FUSED, _GPS = "m-f", "m-g"  # how a place was found
_DELETE_S = 60.0
_CONE_M = 3_000.0  # of the camera's view, for the eye
_LINE, _FILL = -0x22DDDE, 0x30DD2222  # ARGB as a signed number, red
_Attributes = Mapping[str, object]


def fire_event(fire: SharedFire, now_s: float, lifetime_s: float) -> bytes | None:
    """The fire's marker; None without a place.

    `start` is now and not when it was first seen: ATAK takes a marker for stale after 1.5 times `stale - start`.
    """
    if fire.place is None:
        return None
    said = fire.report.properties
    detail = (
        _tag("contact", {"callsign": fire.title})
        + _tag("link", {"uid": drone_uid(said.vehicle), "type": DRONE, "relation": "p-p"})
        + f"<remarks>{_text(chr(10).join(fire.says))}</remarks>"
    )
    ce_m = None if fire.ce90_m is None else fire.ce90_m / RAYLEIGH90
    point = _point(fire.place, fire.height_m, ce_m, _le_m(fire))
    return _event(fire.uid, fire_type(fire), _FUSED, now_s, lifetime_s, point, detail)


def region_event(fire: SharedFire, now_s: float, lifetime_s: float) -> bytes | None:
    """The 95 % ellipse as a closed polygon of the same area, linked to the fire; None where there is none."""
    ring = fire.place and ellipse_ring(*fire.place, fire.report.properties.ellipse95, CORNERS)
    if not ring or fire.place is None:
        return None
    detail = (
        "".join(_tag("link", {"point": f"{lat:.7f},{lon:.7f}"}) for lon, lat in ring)
        + _tag("link", {"uid": fire.uid, "type": fire_type(fire), "relation": "p-p"})
        + _tag("contact", {"callsign": f"95 % {fire.name or fire.label}"})
        + _tag("strokeColor", {"value": _LINE})
        + _tag("strokeWeight", {"value": "3.0"})
        + _tag("fillColor", {"value": _FILL})
        + _tag("labels_on", {"value": "false"})
        + _tag("__shapeExtras", {"cpvis": "false", "editable": "false"})
    )
    point = _point(fire.place, None, None, None)
    return _event(region_uid(fire.uid), REGION, _FUSED, now_s, lifetime_s, point, detail)


def drone_event(drone: SharedDrone, now_s: float, lifetime_s: float) -> bytes | None:
    """The drone, its course and what its camera sees; None without a place."""
    if drone.place is None:
        return None
    detail = _tag("contact", {"callsign": drone.name})
    if drone.course_deg is not None and drone.speed_mps is not None:
        detail += _tag("track", {"course": f"{drone.course_deg % 360.0:.1f}", "speed": f"{drone.speed_mps:.1f}"})
    if drone.view is not None:
        detail += _tag("sensor", _sensor(drone.view))
    if drone.altitude_msl_m is not None:
        detail += f"<remarks>{drone.altitude_msl_m:.0f} m above the sea</remarks>"
    point = _point(drone.place, drone.height_m, None, None)
    return _event(drone.uid, DRONE, _GPS, now_s, lifetime_s, point, detail)


def withdrawal(uid: str, kind: str, place: tuple[float, float], now_s: float) -> bytes:
    """Takes the event `uid` of type `kind` off the maps; ATAK asks for all three of the link, and for the force."""
    detail = _tag("link", {"uid": uid, "type": kind, "relation": "p-p"}) + "<__forcedelete/>"
    point = _point(place, None, None, None)
    return _event(f"{uid}.withdrawn", DELETE, _FUSED, now_s, _DELETE_S, point, detail)


def region_uid(uid: str) -> str:
    return f"{uid}.region"


def _sensor(view: ViewReport) -> _Attributes:
    """ATAK draws a cone of at most 15 km from the azimuth of its middle, `fov` from edge to edge."""
    return {
        "azimuth": f"{view.azimuth_deg % 360.0:.1f}",
        "elevation": f"{view.elevation_deg:.1f}",
        "fov": f"{view.hfov_deg:.1f}",
        "vfov": f"{view.vfov_deg:.1f}",
        "range": f"{_CONE_M:.0f}",
    }


def fire_type(fire: SharedFire) -> str:
    """Smoke until it is confirmed, or where the point is the smoke's own middle."""
    said = fire.report.properties
    return SMOKE if said.state == "tentative" or said.aim != "base" else FIRE


def _le_m(fire: SharedFire) -> float | None:
    """None without a height that it is the error of."""
    return None if fire.le90_m is None or fire.height_m is None else fire.le90_m / NORMAL90


def _point(
    place: tuple[float, float], height_m: float | None, ce_m: float | None, le_m: float | None
) -> dict[str, object]:
    hae, ce, le = (UNKNOWN if one is None else min(one, UNKNOWN) for one in (height_m, ce_m, le_m))
    return {
        "lat": f"{place[0]:.7f}",
        "lon": f"{place[1]:.7f}",
        "hae": f"{hae:.1f}",
        "ce": f"{ce:.1f}",
        "le": f"{le:.1f}",
    }


def _event(uid: str, kind: str, how: str, now_s: float, lifetime_s: float, point: _Attributes, detail: str) -> bytes:
    now, stale = utc_text(now_s), utc_text(now_s + lifetime_s)
    head = {"version": "2.0", "uid": uid, "type": kind, "how": how, "time": now, "start": now, "stale": stale}
    attributes = " ".join(f"{name}={_quoted(value)}" for name, value in head.items())
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<event {attributes}>{_tag("point", point)}'
        f"<detail>{detail}</detail></event>\n"
    ).encode("utf-8", "xmlcharrefreplace")


def _tag(name: str, attributes: _Attributes) -> str:
    return f"<{name} {' '.join(f'{key}={_quoted(value)}' for key, value in attributes.items())}/>"


def _quoted(value: object) -> str:
    return f'"{escape(shown(value, most=200))}"'


def _text(text: str) -> str:
    return escape(shown(text, keep="\n", most=2_000), quote=False)
