"""A drone as other programs are told of it."""

from dataclasses import dataclass

from service.publish.parts import ViewReport
from service.publish.wire import VehicleReport


@dataclass(frozen=True, slots=True)
class SharedDrone:
    """Degrees and metres; None where not known. `height_m` is above the ellipsoid."""

    name: str
    place: tuple[float, float] | None
    height_m: float | None = None
    altitude_msl_m: float | None = None
    course_deg: float | None = None
    speed_mps: float | None = None
    view: ViewReport | None = None

    @property
    def uid(self) -> str:
        return drone_uid(self.name)


def drone_uid(vehicle: str) -> str:
    return f"distloc.{vehicle}"


def drone_from_report(report: VehicleReport, name: str) -> SharedDrone:
    """Its last report's."""
    lat_deg, lon_deg = report.lat_deg, report.lon_deg
    is_on_earth = lat_deg is not None and lon_deg is not None and abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
    return SharedDrone(
        name=name,
        place=(lat_deg, lon_deg) if is_on_earth and lat_deg is not None and lon_deg is not None else None,
        height_m=report.height_m,
        altitude_msl_m=report.altitude_msl_m,
        course_deg=report.course_deg,
        speed_mps=report.speed_mps,
        view=report.view,
    )
