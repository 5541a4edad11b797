"""Drones about one fire and a tower that sees it, with a ground that hears them all."""

import contextlib
import json
import math
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

from service.publish.wire import utc_text
from service.publish.zenoh import ZenohPublisher
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import ellipse, report_bytes, vehicle_bytes

LAT_DEG, LON_DEG, RANGE_M = 47.42774, 8.60559, 2_000.0
NORTH_DEG, EAST_DEG = 1.0 / 111_180.0, 1.0 / (111_320.0 * math.cos(math.radians(LAT_DEG)))


def tell(
    publisher: ZenohPublisher,
    vehicle: str,
    bearing_deg: float,
    across_m: float = 0.0,
    target: int = 1,
    state: str = "confirmed",
    **said: Any,
) -> None:
    """A drone 2 km away that looks along a bearing; its place is so far to the right of the fire."""
    turn = math.radians(bearing_deg)
    lat_deg = LAT_DEG - across_m * math.sin(turn) * NORTH_DEG
    lon_deg = LON_DEG + across_m * math.cos(turn) * EAST_DEG
    publisher.publish_report(
        target,
        report_bytes(
            target,
            vehicle,
            state,
            time.time(),
            lat_deg,
            lon_deg,
            ellipse95=ellipse(130.0, 35.0, bearing_deg % 180.0),
            region95=ellipse(150.0, 55.0, bearing_deg % 180.0),
            range_m=RANGE_M,
            bearing_deg=bearing_deg,
            plume=None,
            **said,
        ),
    )
    away_lat = lat_deg - RANGE_M * math.cos(turn) * NORTH_DEG
    away_lon = lon_deg - RANGE_M * math.sin(turn) * EAST_DEG
    publisher.publish_vehicle(
        vehicle_bytes(vehicle, time.time(), away_lat, away_lon, heading_deg=bearing_deg, footprint=[])
    )


@contextlib.contextmanager
def three(*arguments: str) -> Iterator[tuple[list[ZenohPublisher], str]]:
    """Three drones and the address of the page that hears them."""
    with drone("drone1") as one, drone("drone2") as two, drone("drone3") as other:
        ends = [argument for _, end in (one, two, other) for argument in ("--connect", end)]
        with ground(*ends, *arguments) as served:
            yield [publisher for publisher, _ in (one, two, other)], served.address


def post(address: str, body: bytes, kind: str = "application/json", **headers: str) -> tuple[int, str]:
    """To the ground's `alerts`: status and text."""
    asked = urllib.request.Request(f"{address}alerts", body, {"Content-Type": kind, **headers})
    try:
        with urllib.request.urlopen(asked) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def alert(azimuth_deg: float = 180.0, **said: object) -> bytes:
    told = {
        "platform": "tower1",
        "lat_deg": LAT_DEG + 6_000.0 * NORTH_DEG,
        "lon_deg": LON_DEG,
        "azimuth_deg": azimuth_deg,
        "opening_deg": 2.0,
        "time_utc": utc_text(time.time()),
        "sigma_deg": 0.3,
    }
    return json.dumps(told | said).encode()
