"""A fire as other programs are told of it: the drone's last report, and what the ground knows beside it."""

import math
from collections import OrderedDict
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np

from distloc.filter.uncertainty import CHI2_95, NORMAL90, NORMAL95, circular_error90_m
from service.common.messages import LocatedTarget
from service.common.shown import shown
from service.publish.exchange.judged import judged
from service.publish.exchange.rings import LARGEST_M, known_ellipse
from service.publish.wire import Report, utc_text

_MOST_UIDS = 256  # a flight has 64 places for fires
_MOST_NAMES = 16  # in a line
_MOST_M = 99_999.0
_STATES = {
    "tentative": "not sure yet",
    "confirmed": "confirmed",
    "coasting": "confirmed, out of view now",
    "dismissed": "given up by the drone",
}


@dataclass(frozen=True, slots=True)
class MadeOf:
    """What a ground fused a fire of, by the labels of the drones' own fires, and the names of towers that see it."""

    contributors: tuple[str, ...]
    undecided: tuple[str, ...] = ()
    outvoted: tuple[str, ...] = ()
    towers: tuple[str, ...] = ()

    @property
    def others(self) -> int:
        """How many tell of it beside the first."""
        return len(self.contributors) + len(self.towers) - 1

    @property
    def says(self) -> list[str]:
        """What a person reads of it, line by line."""
        lines = ["one fire of " + ", ".join((*self.contributors, *self.towers)[:_MOST_NAMES])]
        if self.undecided:
            lines.append("perhaps also " + ", ".join(self.undecided[:_MOST_NAMES]) + ", not counted")
        if self.outvoted:
            lines.append("outvoted: " + ", ".join(self.outvoted[:_MOST_NAMES]) + ": check its compass and mount")
        return lines


@dataclass(frozen=True, slots=True)
class Outvoted:
    """The label of the fire of others that contradict this one, and how far away they put it."""

    by: str
    away_m: float


@dataclass(frozen=True, slots=True)
class SharedFire:
    """`uid` stays over restarts; times are UTC in seconds by the clock of who shares it, None where not known.

    `is_withdrawn`: given up, or no fire as the crew says. Where several tell of it (`made_of`), `report` is that of
    the surest of them, with the place, the size and the state that all together give.
    """

    uid: str
    label: str
    report: Report
    told_s: float | None
    seen_s: float | None
    name: str = ""
    is_acknowledged: bool = False
    is_no_fire: bool = False
    is_earlier: bool = False
    made_of: MadeOf | None = None
    outvoted: Outvoted | None = None

    @property
    def vehicle(self) -> str:
        return shown(self.report.properties.vehicle, most=64)

    @property
    def degraded(self) -> list[str]:
        """Short and printable."""
        return [shown(one, most=64) for one in self.report.properties.degraded[:32]]

    @property
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude in degrees; None where they are no place on earth."""
        geometry = self.report.geometry
        if geometry is None or len(geometry.coordinates) < 2:
            return None
        lon_deg, lat_deg = geometry.coordinates[:2]
        return (lat_deg, lon_deg) if abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 else None

    @property
    def height_m(self) -> float | None:
        """Above the ellipsoid; None where the drone knows no geoid. Never the height above the sea."""
        geometry = self.report.geometry
        if geometry is None or len(geometry.coordinates) < 3:
            return None
        height_m = geometry.coordinates[2]
        return height_m if abs(height_m) < 12_000.0 else None

    @property
    def is_withdrawn(self) -> bool:
        return self.is_no_fire or self.report.properties.state == "dismissed"

    @property
    def size_m(self) -> tuple[float, float] | None:
        """The semi-axes of `ellipse95`, the long one first; None where they are no size of a place's error."""
        one = known_ellipse(self.report.properties.ellipse95)
        return None if one.semi_major_m is None or one.semi_minor_m is None else (one.semi_major_m, one.semi_minor_m)

    @property
    def ce90_m(self) -> float | None:
        """The radius of the circle that holds the place with 90 %: as told, else of a normal error with `ellipse95`."""
        told_m = self.report.properties.ce90_m
        if self.size_m is None:
            return None
        if told_m is not None and 0.0 < told_m <= LARGEST_M:
            return told_m
        return circular_error90_m(np.diag(np.square(self.size_m)) / CHI2_95)

    @property
    def le90_m(self) -> float | None:
        """Half of the height's interval of 90 %: as told, else by `vertical95_m`."""
        said = self.report.properties
        if said.le90_m is not None and 0.0 < said.le90_m <= LARGEST_M:
            return said.le90_m
        half_m = said.vertical95_m
        return None if half_m is None or not 0.0 < half_m <= LARGEST_M else half_m * NORMAL90 / NORMAL95

    @property
    def labels(self) -> tuple[str, ...]:
        """Its own, and those of drones' fires that it stands for."""
        return (self.label,) if self.made_of is None else (self.label, *self.made_of.contributors)

    @property
    def title(self) -> str:
        """Its name, never without how sure its place is, or that others contradict it."""
        others = 0 if self.made_of is None else self.made_of.others
        name = self.name or f"Fire {self.label}" + (f" +{others}" if others > 0 else "")
        size = "place not known well" if self.size_m is None else "+-{:.0f}x{:.0f}m".format(*self.size_m)
        return f"{name} {'outvoted ' if self.outvoted else ''}{size}"

    @property
    def advice(self) -> str:
        """What the drone would have to fly to make it surer: `fly 040 400 m for +-80 m`; empty where there is none."""
        one = self.report.properties.advice
        if one is None or one.heading_deg is None or one.length_m is None:
            return ""
        way = "arc about it from" if one.kind == "arc" else "fly"
        gain = "" if one.half_length_m is None else f" for +-{min(one.half_length_m, _MOST_M):.0f} m"
        return f"{way} {round(one.heading_deg) % 360:03d} {min(one.length_m, _MOST_M):.0f} m{gain}"

    @property
    def says(self) -> list[str]:
        """What a person reads of it, line by line."""
        said = self.report.properties
        state = "not a fire, says the crew" if self.is_no_fire else _STATES[said.state]
        lines = [f"{self.label}: {state}{', seen by the crew' if self.is_acknowledged else ''}"]
        if self.outvoted is not None:
            lines.append(f"outvoted: others put it {self.outvoted.away_m:.0f} m away, at {self.outvoted.by}")
        lines += [] if self.made_of is None else self.made_of.says
        if self.size_m is not None and said.ellipse95.azimuth_deg is not None:
            lines.append(
                "95 % within {:.0f} x {:.0f} m, long axis {:.0f} deg".format(*self.size_m, said.ellipse95.azimuth_deg)
            )
        if said.altitude_msl_m is not None:
            lines.append(f"{said.altitude_msl_m:.0f} m above the sea" + _plus_minus(said.vertical95_m))
        if said.range_m is not None and said.bearing_deg is not None:
            drone = "the drone" if self.made_of is None else self.vehicle
            lines.append(f"seen {said.range_m / 1000.0:.1f} km at {said.bearing_deg:.0f} deg from {drone}")
        if self.seen_s is not None:
            lines.append(f"last seen {utc_words(self.seen_s)}")
        if said.motion != "fixed":
            lines.append("it moves" if said.motion == "moving" else "whether it stands still is not known")
        if self.advice:
            lines.append(f"to be surer: {self.advice}" + ("" if self.made_of is None else f" ({self.vehicle})"))
        if self.degraded:
            lines.append("degraded: " + ", ".join(self.degraded[:8]))
        return lines


class OwnFires:
    """The drone's own fires as it shares them: each keeps the uid that it was told by first, whatever its times become.

    A clock that is set, or read a little better, moves when a fire was first seen.
    """

    def __init__(self, vehicle: str) -> None:
        self._vehicle = vehicle
        self._uids: OrderedDict[int, str] = OrderedDict()

    def shared(self, target: LocatedTarget, report: Report) -> SharedFire:
        """As it is now."""
        number = target.estimate.id
        uid = self._uids.setdefault(number, fire_uid(self._vehicle, number, target.first_seen_utc_s))
        self._uids.move_to_end(number)
        if len(self._uids) > _MOST_UIDS:
            self._uids.popitem(last=False)
        return SharedFire(
            uid=uid,
            label=f"{self._vehicle}/{number}",
            report=judged(report),
            told_s=target.time_utc_s,
            seen_s=target.last_seen_utc_s,
        )


def fire_uid(vehicle: str, target: int, first_seen_s: float | None) -> str:
    """The same after a restart, another for the next flight's fire of that number: it has when it was first seen.

    To the minute, as a time that was kept over a restart comes back to some milliseconds only.
    """
    first = ""
    if first_seen_s is not None and 0.0 <= first_seen_s < 4e9:
        first = f".{datetime.fromtimestamp(first_seen_s, timezone.utc):%Y%m%dT%H%M}"
    return f"distloc.{vehicle}.{target}{first}"


def utc_words(time_s: float) -> str:
    """For people: `2026-11-28 15:47:12 UTC`."""
    text = utc_text(time_s)
    return "at no time that could be" if text is None else f"{text[:10]} {text[11:19]} UTC"


def _plus_minus(half_m: float | None) -> str:
    return "" if half_m is None or not math.isfinite(half_m) else f" +-{half_m:.0f} m"
