"""Reports, states and places of drones as they come over zenoh, for the tests of the ground."""

from typing import Any

import msgspec

from distloc.types import TargetState
from service.ground.inbox import Heard
from service.publish.parts import EllipseReport
from service.publish.wire import Report, StatusReport, VehicleReport, encode, report_from_target, utc_text
from tests.support.wire_samples import located

NOW_S = 1_800_000_100.0


def report(
    target: int = 3,
    vehicle: str = "drone1",
    state: str = "confirmed",
    at_s: float = NOW_S,
    lat_deg: float = 47.42774,
    lon_deg: float = 8.60559,
    **said: Any,
) -> Report:
    """A report told at `at_s` of what was seen a second before; `said` are properties in place of the sample's."""
    made = report_from_target(located(target, TargetState(state), lat_deg=lat_deg, lon_deg=lon_deg), vehicle)
    times = {"time_utc": utc_text(at_s), "last_seen_utc": utc_text(at_s - 1.0), "first_seen_utc": utc_text(1.8e9)}
    return msgspec.structs.replace(made, properties=msgspec.structs.replace(made.properties, **(times | said)))


def report_bytes(*arguments: Any, **said: Any) -> bytes:
    """As it goes over zenoh."""
    return encode(report(*arguments, **said))


def ellipse(semi_major_m: float | None, semi_minor_m: float | None, azimuth_deg: float | None) -> EllipseReport:
    """As in a report."""
    return EllipseReport(semi_major_m=semi_major_m, semi_minor_m=semi_minor_m, azimuth_deg=azimuth_deg)


def status_bytes(vehicle: str = "drone1", at_s: float = NOW_S, degraded: tuple[str, ...] = ()) -> bytes:
    """A drone's health."""
    state = "degraded" if degraded else "ok"
    return encode(StatusReport(vehicle=vehicle, time_utc=utc_text(at_s), state=state, degraded=list(degraded)))


def vehicle_bytes(
    vehicle: str = "drone1", at_s: float = NOW_S, lat_deg: float = 47.41, lon_deg: float = 8.56, **said: Any
) -> bytes:
    """Where a drone is."""
    made = VehicleReport(
        vehicle=vehicle,
        time_utc=utc_text(at_s),
        time_source="gps",
        lat_deg=lat_deg,
        lon_deg=lon_deg,
        altitude_msl_m=900.0,
        heading_deg=70.0,
        footprint=[[8.57, 47.42], [8.62, 47.45], [8.64, 47.42]],
    )
    return encode(msgspec.structs.replace(made, **said))


def heard(key: str, payload: bytes | None, arrived_s: float = NOW_S) -> Heard:
    """A message as the inbox has it."""
    return Heard(f"distloc/{key}", payload, arrived_s, "")
