"""Fires as GeoJSON (RFC 7946): points, and the ellipses about them as polygons."""

from collections.abc import Iterable
from typing import Any

import msgspec

from service.publish.exchange.fire import SharedFire
from service.publish.exchange.listing import row
from service.publish.exchange.rings import Ring, cut_at_antimeridian, ellipse_ring
from service.publish.exchange.tower import SharedTower, sector_ring
from service.publish.wire import utc_text

GEOJSON = "application/geo+json"
KINDS = ("ellipse95", "region95")


def point_feature(fire: SharedFire) -> dict[str, Any]:
    """The fire itself; its geometry is null where it has no place, and has a height only above the ellipsoid."""
    geometry = None
    if fire.place is not None:
        lat_deg, lon_deg = fire.place
        height = [] if fire.height_m is None else [fire.height_m]
        geometry = {"type": "Point", "coordinates": [lon_deg, lat_deg, *height]}
    return _feature(fire.uid, geometry, row(fire))


def region_features(fire: SharedFire) -> list[dict[str, Any]]:
    """`ellipse95`, which holds the fire, and `region95`, which holds its smoke too; those that are known."""
    found = []
    for kind in KINDS:
        rings = region_rings(fire, kind)
        if rings:
            properties = {"kind": kind, "fire": fire.label, "uid": fire.uid, "state": fire.report.properties.state}
            found.append(_feature(f"{fire.uid}.{kind}", polygon(rings), properties))
    return found


def sector_features(tower: SharedTower) -> list[dict[str, Any]]:
    """Where it sees smoke, a wedge each."""
    found = []
    for sector in tower.sectors:
        properties = {
            "kind": "sector",
            "tower": tower.name,
            "azimuth_deg": sector.azimuth_deg,
            "opening_deg": sector.opening_deg,
            "told_utc": utc_text(sector.told_s),
            "fire_uid": sector.fire,
        }
        rings = cut_at_antimeridian(sector_ring(tower, sector))
        found.append(_feature(tower.sector_uid(sector), polygon(rings), properties))
    return found


def region_rings(fire: SharedFire, kind: str) -> list[Ring]:
    """The ring of `ellipse95` or `region95`, two where the antimeridian cuts it, none where it is not known."""
    if fire.place is None:
        return []
    ring = ellipse_ring(*fire.place, getattr(fire.report.properties, kind))
    return [] if ring is None else cut_at_antimeridian(ring)


def polygon(rings: list[Ring]) -> dict[str, Any]:
    """One as a Polygon, several as a MultiPolygon."""
    if len(rings) == 1:
        return {"type": "Polygon", "coordinates": [rings[0]]}
    return {"type": "MultiPolygon", "coordinates": [[ring] for ring in rings]}


def collection(features: Iterable[dict[str, Any]], **more: object) -> bytes:
    """A FeatureCollection's bytes."""
    return msgspec.json.encode({"type": "FeatureCollection", "features": list(features), **more})


def fires_collection(fires: Iterable[SharedFire]) -> bytes:
    """All: of each fire its point, then its regions."""
    return collection(feature for fire in fires for feature in (point_feature(fire), *region_features(fire)))


def _feature(identity: str, geometry: dict[str, Any] | None, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "id": identity, "geometry": geometry, "properties": properties}
