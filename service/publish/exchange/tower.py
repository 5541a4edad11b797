"""A tower as other programs are told of it: where it stands, and in which directions it sees smoke."""

import math
from dataclasses import dataclass

from distloc.geometry.geodesy import LocalFrame
from service.common.shown import shown
from service.publish.exchange.rings import Ring, closed

REACH_M = 40_000.0  # of a sector on the map, as on the page
_STEP_DEG = 2.0


@dataclass(frozen=True, slots=True)
class Sector:
    """`fire` is the uid of the fire that it is surely of, else empty; the time is UTC in seconds."""

    azimuth_deg: float
    opening_deg: float
    told_s: float
    fire: str = ""


@dataclass(frozen=True, slots=True)
class SharedTower:
    """Degrees; the sectors that hold now."""

    name: str
    place: tuple[float, float]
    sectors: tuple[Sector, ...]

    def sector_uid(self, sector: Sector) -> str:
        return f"distloc.tower.{self.name}.{round(sector.azimuth_deg) % 360}"

    def says(self, sector: Sector) -> str:
        """What a person reads of it."""
        whose = f"of {sector.fire}" if sector.fire else "of no fire for sure"
        return f"{shown(self.name, most=64)}: smoke at {sector.azimuth_deg:.0f} deg, {whose}"


def sector_ring(tower: SharedTower, sector: Sector) -> Ring:
    """The wedge, counterclockwise."""
    steps = max(math.ceil(sector.opening_deg / _STEP_DEG), 1)
    left = sector.azimuth_deg - 0.5 * sector.opening_deg
    turns = [math.radians(left + sector.opening_deg * step / steps) for step in range(steps, -1, -1)]
    arc = [(REACH_M * math.sin(turn), REACH_M * math.cos(turn), 0.0) for turn in turns]
    start = (0.0, 0.0, 0.0)
    return closed([start, *arc, start], LocalFrame(*tower.place, 0.0))
