"""A network of lookout cameras and the fires of a season: what real ones do to whoever locates by them.

Cameras stand in fours on hilltops, each with a heading that errs by degrees and stays so for weeks, until somebody
turns it. Each sees the smoke, not the fire: a plume that grows and leans with the wind, its foot under a crest, in a
box whose middle is the plume's, and now and then something else. What is recorded of an ignition is not exact either.
"""

import math
from dataclasses import dataclass

import numpy as np

from distloc.batch.sighting import Sighting
from distloc.study.ignitions.known import Ignition, KnownFire
from distloc.types import FloatArray
from tests.support.sightings import FRAME, seen

DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Season:
    """What a network is like; angles in degrees, one standard deviation."""

    sites: int = 12
    fires: int = 24
    heading_bias_deg: float = 2.5
    tilt_bias_deg: float = 0.7
    turned_every_days: float = 60.0
    looks: int = 12
    box_deg: float = 0.15  # how a box's edges jump
    wind_mps: float = 4.0
    something_else: float = 0.03  # share of the boxes
    never_the_fire: float = 0.03  # share of the cameras that see only something else
    recorded_m: float = 150.0
    days: float = 120.0


def season(rng: np.random.Generator, of: Season | None = None) -> list[KnownFire]:
    """The fires that two or more cameras saw."""
    of = of or Season()
    sites = np.stack(
        [*rng.uniform(-30e3, 30e3, (2, of.sites)), rng.uniform(300.0, 1500.0, of.sites)], axis=1
    )  # fmt: skip
    cameras = [_Camera(rng, of, place, quarter) for place in sites for quarter in range(4)]
    fires = []
    for number in range(of.fires):
        start_s = DAY_S * rng.uniform(0.0, of.days)
        fire = np.append(rng.uniform(-25e3, 25e3, 2), rng.uniform(100.0, 900.0))
        plume = _Plume(rng, of)
        sightings: list[Sighting] = []
        for camera in cameras:
            if camera.sees(fire) and rng.random() < 0.6:
                sightings += camera.watched(rng, of, fire, plume, start_s, f"fire{number}")
        if len({one.platform for one in sightings}) < 2:
            continue
        recorded = fire + np.append(of.recorded_m * rng.standard_normal(2), 0.0)
        lat, lon, _ = FRAME.geodetic_from_enu(recorded)
        fires.append(KnownFire(f"fire{number}", tuple(sightings), Ignition(lat, lon, of.recorded_m)))
    return fires


class _Plume:
    """Smoke that leans with the wind: its middle goes away from the fire as it grows, then stays."""

    def __init__(self, rng: np.random.Generator, of: Season) -> None:
        towards, speed = rng.uniform(0.0, 2.0 * math.pi), of.wind_mps * rng.gamma(4.0, 0.25)
        self._drift_mps = 0.5 * speed * np.array([math.sin(towards), math.cos(towards), 0.0])  # the middle's: half
        self._rise_mps = rng.uniform(0.3, 1.0)
        self._seen_s = rng.uniform(120.0, 600.0)  # for so long the smoke is thick enough to be seen

    def middle_m(self, age_s: float) -> FloatArray:
        """From the fire (3,)."""
        length_s = min(age_s, self._seen_s)
        return self._drift_mps * length_s + np.array([0.0, 0.0, 0.5 * self._rise_mps * length_s])


class _Camera:
    def __init__(self, rng: np.random.Generator, of: Season, place: FloatArray, quarter: int) -> None:
        self._place = place
        self._looks_rad = quarter * 0.5 * math.pi
        self.name = f"site{round(place[0])}_{'neswn'[quarter]}"
        self._turned_s = np.cumsum(rng.exponential(DAY_S * of.turned_every_days, 50))
        sigmas = np.radians([of.tilt_bias_deg, of.tilt_bias_deg, of.heading_bias_deg])
        self._biases_rad = rng.standard_normal((51, 3)) * sigmas

    def sees(self, fire: FloatArray) -> bool:
        """Within its quarter, 3 to 35 km away."""
        east_m, north_m = (fire - self._place)[:2]
        beside = (math.atan2(east_m, north_m) - self._looks_rad + math.pi) % (2.0 * math.pi) - math.pi
        return abs(beside) < 0.25 * math.pi and 3e3 < math.hypot(east_m, north_m) < 35e3

    def watched(
        self, rng: np.random.Generator, of: Season, fire: FloatArray, plume: _Plume, start_s: float, target: str
    ) -> list[Sighting]:
        """A box a minute or so from when it is first seen."""
        bias = self._biases_rad[int(np.searchsorted(self._turned_s, start_s))]
        first_s, hidden_m = rng.uniform(60.0, 600.0), rng.exponential(80.0)
        range_m = float(np.linalg.norm(fire - self._place))
        is_wrong = rng.random() < of.never_the_fire
        wrong_rad = rng.uniform(-0.3, 0.3)
        sightings = []
        for look in range(of.looks):
            age_s = first_s + 120.0 * look
            middle = plume.middle_m(age_s)
            across = np.cross((fire - self._place) / range_m, [0.0, 0.0, 1.0])
            half_rad = max(abs(float(middle @ across)) / range_m, math.radians(0.2))
            jump = np.append(np.zeros(2), np.radians(of.box_deg) * rng.standard_normal())
            if is_wrong or rng.random() < of.something_else:
                jump[2] += wrong_rad if is_wrong else rng.uniform(-0.5, 0.5)
            foot = fire + np.array([middle[0], middle[1], hidden_m])
            sigma_rad = 2.0 * half_rad / math.sqrt(12.0), math.radians(0.1)
            sightings.append(
                seen(
                    self._place,
                    foot,
                    bias + jump,
                    platform=self.name,
                    stamp_s=start_s + age_s,
                    target=target,
                    sigma_rad=sigma_rad,
                )
            )
        return sightings
