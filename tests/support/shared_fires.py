"""Fires as other programs are told of them, and how a reader of their events takes them."""

from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from pyproj import Geod

from service.publish.exchange.fire import SharedFire, fire_uid
from service.publish.wire import utc_text
from tests.support.ground_samples import NOW_S, report

WGS84 = Geod(ellps="WGS84")
RED = {"strokeColor", "fillColor"}


def shared(target: int = 3, state: str = "confirmed", seen_s: float | None = NOW_S - 1.0, **said: Any) -> SharedFire:
    """A fire told at NOW_S; `said` as `report` takes it."""
    told_s = NOW_S if seen_s is None else seen_s + 1.0
    made = report(target, state=state, at_s=told_s, **said)
    return SharedFire(fire_uid("drone1", target, 1.8e9), f"drone1/{target}", made, told_s, seen_s)


def area_m2(ring: list[tuple[float, float]] | np.ndarray) -> float:
    """On the ellipsoid, of (lon, lat); positive where the ring runs counterclockwise."""
    lons, lats = np.array(ring).T
    return float(WGS84.polygon_area_perimeter(lons, lats)[0])


def ellipse_area_m2(fire: SharedFire, kind: str = "ellipse95") -> float:
    one = getattr(fire.report.properties, kind)
    return float(np.pi * one.semi_major_m * one.semi_minor_m)


@dataclass
class Drawn:
    """What ATAK makes of an event: by its own importers (MarkerImporter, DrawingImporter, CotDeleteImporter)."""

    uid: str
    kind: str
    lat_lon: tuple[float, float]
    hae_m: float | None
    ce90_m: float | None
    corners: list[tuple[float, float]]
    is_closed: bool
    fades_after_s: float | None
    removes: str | None
    title: str


def drawn(event: bytes) -> Drawn:
    """A marker fades 1.5 times stale - start after it came; a drawing never does and takes its corners from the links
    that have a point; a delete counts with uid, type and relation of its link and the force alone."""
    root = ElementTree.fromstring(event)
    point, detail = root.find("point"), root.find("detail")
    assert root.tag == "event" and root.get("version") == "2.0" and point is not None and detail is not None
    kind = root.get("type", "")
    points = [one.get("point") for one in detail.findall("link")]
    corners = [tuple(map(float, one.split(",")[:2])) for one in points if one is not None]
    start_s, stale_s = (seconds(root.get(name, "")) for name in ("start", "stale"))
    link, contact = detail.find("link"), detail.find("contact")
    removes = None
    if kind == "t-x-d-d" and link is not None and detail.find("__forcedelete") is not None:
        assert link.get("type") and link.get("relation")
        removes = link.get("uid")
    ce, hae = float(point.get("ce", "")), float(point.get("hae", ""))
    return Drawn(
        uid=root.get("uid", ""),
        kind=kind,
        lat_lon=(float(point.get("lat", "")), float(point.get("lon", ""))),
        hae_m=None if hae == 9_999_999.0 else hae,
        ce90_m=None if ce == 9_999_999.0 else 2.146 * ce,
        corners=[(lon, lat) for lat, lon in corners] if kind == "u-d-f" else [],
        is_closed=len(corners) > 3 and corners[0] == corners[-1],
        fades_after_s=1.5 * (stale_s - start_s) if kind.startswith("a-") else None,
        removes=removes,
        title="" if contact is None else contact.get("callsign", ""),
    )


def seconds(text: str) -> float:
    """Of a CoT time; it is as our reports write theirs."""
    from service.publish.wire import utc_s

    made = utc_s(text)
    assert utc_text(made) == text
    return made
