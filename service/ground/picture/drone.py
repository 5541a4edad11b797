"""One drone's part of the picture: where it is, how it is, its clock and its way."""

import math
from collections.abc import Sequence

from service.common.shown import shown
from service.ground.picture.clock import DroneClock, utc_s_from_text
from service.ground.picture.path import Path
from service.ground.picture.views import DroneView
from service.publish.exchange.drone import SharedDrone, drone_from_report
from service.publish.parts import Number
from service.publish.wire import StatusReport, VehicleReport

MOST_NAMES, MOST_CORNERS, MOST_REASONS = 32, 80, 8
NAME_CHARACTERS = 64
_LIVE_S, _SILENT_S, STAYS = 10.0, 60.0, 3
_TWICE_S = 5.0  # two senders of one name within so long are two drones, not one that was started again


class Drone:
    """Takes what is heard of a drone; `view` is what the page is told."""

    def __init__(self, name: str, now_s: float) -> None:
        self.name = name
        self.heard_s = now_s
        self.told_s: float | None = None  # anything of use
        self.is_alive: bool | None = None
        self.clock = DroneClock()
        self.refused: dict[str, int] = {}
        self.preview_s: float | None = None
        self.is_by_terrain = False  # its ranges come from a DEM or a plain, as others' may
        self._state, self._degraded, self._says = "", list[str](), list[str]()
        self._place: tuple[Number, Number, Number, Number] = (None, None, None, None)
        self._footprint: list[list[float]] = []
        self._path = Path()
        self._last: VehicleReport | None = None
        self._last_s = -math.inf
        self._sender, self._other_s, self._twice_s = "", -math.inf, -math.inf

    def refuse(self, reason: str, count: int = 1) -> None:
        """Count what could not be used; the reasons are ours, so they are few."""
        self.refused[reason] = self.refused.get(reason, 0) + count

    def sent_by(self, sender: str, now_s: float) -> None:
        """Which zenoh session says so: one that comes back after another is a second drone of this name."""
        if sender and sender != self._sender:
            if now_s - self._other_s < _TWICE_S:
                self._twice_s = now_s
            self._other_s = now_s if self._sender else -math.inf
            self._sender = sender

    def status(self, status: StatusReport, now_s: float) -> bool:
        """How it is; whether its clock turned out to be another."""
        self._state = status.state
        self._degraded = names(status.degraded)
        ground = status.counters.get("ground")
        self.is_by_terrain = isinstance(ground, dict) and ground.get("used") in ("flat", "dem")
        tracks = status.explain.tracks if status.explain else []
        self._says = [shown(one.says) for one in tracks[:MOST_REASONS]]
        return self.clock.hear(utc_s_from_text(status.time_utc), now_s)

    def vehicle(self, report: VehicleReport, now_s: float) -> bool:
        """Where it is; whether its clock turned out to be another."""
        self._last, self._last_s = report, now_s
        lat_deg, lon_deg = report.lat_deg, report.lon_deg
        if lat_deg is not None and lon_deg is not None and on_earth(lat_deg, lon_deg):
            self._place = (lat_deg, lon_deg, report.altitude_msl_m, report.heading_deg)
            self._path.add(lon_deg, lat_deg)
        self._footprint = [
            [lon, lat]
            for lon, lat in (corner for corner in report.footprint[:MOST_CORNERS] if len(corner) == 2)
            if lon is not None and lat is not None and on_earth(lat, lon)
        ]
        return self.clock.hear(utc_s_from_text(report.time_utc), now_s)

    @property
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude in degrees, where it has told."""
        lat_deg, lon_deg, _, _ = self._place
        return None if lat_deg is None or lon_deg is None else (lat_deg, lon_deg)

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much."""
        self.heard_s += step_s
        self.told_s = None if self.told_s is None else self.told_s + step_s
        self.preview_s = None if self.preview_s is None else self.preview_s + step_s
        self._last_s += step_s
        self._other_s += step_s
        self._twice_s += step_s
        self.clock.set_on(step_s)

    def is_missed(self, now_s: float) -> int:
        """0 where it is gone, 1 where it never told anything of use, 2 after a minute of silence, else STAYS."""
        reasons = (self.is_alive is False, self.told_s is None, now_s - self.heard_s > _SILENT_S)
        return reasons.index(True) if any(reasons) else STAYS

    def shared(self, now_s: float) -> SharedDrone | None:
        """As other programs are told; None where it did not say within 10 s where it is."""
        if self._last is None or now_s - self._last_s > _LIVE_S:
            return None
        return drone_from_report(self._last, self.name)

    def view(self, now_s: float) -> DroneView:
        """As the page is told."""
        lat_deg, lon_deg, altitude_msl_m, heading_deg = self._place
        return DroneView(
            name=self.name,
            is_alive=self.is_alive,
            heard_s=self.heard_s,
            clock_behind_s=self.clock.behind_s,
            may_be_delay=self.clock.may_be_delay,
            state=self._state,
            degraded=self._degraded,
            says=self._says,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            altitude_msl_m=altitude_msl_m,
            heading_deg=heading_deg,
            footprint=self._footprint,
            path=self._path.points,
            preview_s=self.preview_s,
            refused=dict(self.refused),
            is_twice=now_s - self._twice_s < 2.0 * _TWICE_S,
        )


def names(degraded: Sequence[str]) -> list[str]:
    """Short and printable, no more than 32."""
    return [shown(one, most=NAME_CHARACTERS) for one in degraded[:MOST_NAMES]]


def on_earth(lat_deg: float, lon_deg: float) -> bool:
    """Whether these are degrees of a place; not for NaN."""
    return abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
