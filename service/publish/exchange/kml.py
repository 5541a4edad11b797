"""KML 2.2: what its documents are made of, and the fires and drones of the ground in it.

Fires lie on the ground whatever height was found (`clampToGround`); a drone's `absolute` height is above the sea, as
KML has it.
"""

from collections.abc import Iterable, Mapping, Sequence
from html import escape

from service.common.shown import shown
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.features import KINDS, region_rings
from service.publish.exchange.fire import SharedFire
from service.publish.exchange.listing import row
from service.publish.exchange.rings import Ring, cut_at_antimeridian
from service.publish.exchange.tower import SharedTower, sector_ring

KML = "application/vnd.google-earth.kml+xml"
_RED, _ORANGE, _GREY, _BLUE = "2222dd", "1490ee", "888888", "b05a10"  # blue, green, red, as KML writes colours
_ICONS = {"confirmed": (_RED, 1.2), "coasting": (_RED, 0.9), "tentative": (_ORANGE, 0.8), "gone": (_GREY, 0.7)}
_LINES = {"ellipse95": (_RED, "33"), "region95": (_ORANGE, "11"), "sector": (_BLUE, "22")}


def document(name: str, parts: Iterable[str]) -> bytes:
    """The file's bytes; `parts` are styles, placemarks and links."""
    head = f'<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="{_NAMESPACE}"><Document><name>{text(name)}</name>\n'
    return (head + "\n".join(parts) + "\n</Document></kml>\n").encode("utf-8", "xmlcharrefreplace")


def placemark(
    name: str, geometry: str, style: str = "", says: str = "", data: Mapping[str, object] | None = None
) -> str:
    """One mark; `geometry` is what `point` or `areas` made, all else is text."""
    parts = [f"<name>{text(name)}</name>"]
    if says:
        parts.append(f"<description>{text(says)}</description>")
    if style:
        parts.append(f"<styleUrl>#{style}</styleUrl>")
    if data:
        values = "".join(
            f'<Data name="{text(key)}"><value>{text(value)}</value></Data>'
            for key, value in data.items()
            if value is not None
        )
        parts.append(f"<ExtendedData>{values}</ExtendedData>")
    return f"<Placemark>{''.join(parts)}{geometry}</Placemark>"


def point(lat_deg: float, lon_deg: float, altitude_msl_m: float | None = None) -> str:
    """On the ground, or at a height above the sea with a line down to the ground."""
    if altitude_msl_m is None:
        return f"<Point><coordinates>{lon_deg:.8f},{lat_deg:.8f}</coordinates></Point>"
    return (
        "<Point><extrude>1</extrude><altitudeMode>absolute</altitudeMode>"
        f"<coordinates>{lon_deg:.8f},{lat_deg:.8f},{altitude_msl_m:.1f}</coordinates></Point>"
    )


def areas(rings: Sequence[Ring]) -> str:
    """Polygons on the ground."""
    parts = "".join(
        "<Polygon><tessellate>1</tessellate><altitudeMode>clampToGround</altitudeMode><outerBoundaryIs><LinearRing>"
        f"<coordinates>{' '.join(f'{lon:.7f},{lat:.7f}' for lon, lat in ring)}</coordinates>"
        "</LinearRing></outerBoundaryIs></Polygon>"
        for ring in rings
    )
    return parts if len(rings) == 1 else f"<MultiGeometry>{parts}</MultiGeometry>"


def area_style(name: str, colour: str = _RED, fill_alpha: str = "33") -> str:
    return (
        f'<Style id="{name}"><LineStyle><color>ff{colour}</color><width>2</width></LineStyle>'
        f"<PolyStyle><color>{fill_alpha}{colour}</color></PolyStyle></Style>"
    )


def text(value: object) -> str:
    """Escaped, printable."""
    return escape(shown(value, keep="\n", most=2_000))


def fires_document(
    fires: Iterable[SharedFire], drones: Iterable[SharedDrone] = (), towers: Iterable[SharedTower] = ()
) -> bytes:
    """The fires with their regions, the drones, and the towers with the directions in which they see smoke."""
    parts = [
        f'<Style id="{name}"><IconStyle><color>ff{colour}</color><scale>{scale}</scale></IconStyle></Style>'
        for name, (colour, scale) in _ICONS.items()
    ]
    parts += [area_style(name, *look) for name, look in _LINES.items()]
    for fire in fires:
        parts += _fire(fire)
    for drone in drones:
        if drone.place is not None:
            parts.append(placemark(drone.name, point(*drone.place, drone.altitude_msl_m)))
    for tower in towers:
        parts.append(placemark(tower.name, point(*tower.place)))
        for sector in tower.sectors:
            rings = cut_at_antimeridian(sector_ring(tower, sector))
            parts.append(
                placemark(f"{tower.name} {sector.azimuth_deg:.0f}", areas(rings), "sector", tower.says(sector))
            )
    return document("distloc", parts)


def network_link(href: str, refresh_s: int) -> bytes:
    """A file that has the viewer fetch `href` again and again; it moves no view."""
    link = (
        f"<href>{text(href)}</href><refreshMode>onInterval</refreshMode><refreshInterval>{refresh_s}</refreshInterval>"
    )
    return document(
        "distloc",
        [f"<NetworkLink><name>distloc: fires</name><flyToView>0</flyToView><Link>{link}</Link></NetworkLink>"],
    )


def _fire(fire: SharedFire) -> list[str]:
    if fire.place is None:
        return []
    state = "gone" if fire.is_withdrawn or fire.is_earlier else fire.report.properties.state
    marks = [placemark(fire.title, point(*fire.place), state, "\n".join(fire.says), row(fire))]
    if state == "gone":
        return marks
    for kind in KINDS:
        rings = region_rings(fire, kind)
        if rings:
            marks.append(placemark(f"{fire.label} {kind}", areas(rings), kind))
    return marks


_NAMESPACE = "http://www.opengis.net/kml/2.2"
