"""A fleet as it is drawn: where drones are, what they are off by, and what they would report, without flying them.

A report is a Gaussian with the shape of a real one: long along the line of sight. Its error is drawn from what it
tells, but for the errors that all have in common, of GNSS and of the aim at the smoke, and for the few drones that are
worse than they tell.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from distloc.batch.fusion.claims import Claim
from distloc.batch.fusion.shared import shared_part
from distloc.types import FloatArray

STEP_S, STEPS = 2.0, 60
APART_M = 300.0  # two fires
SHARED_M = 1.5  # of GNSS, an axis
AIM_M = 25.0  # of the aim at a fire's smoke, an axis: `study scenes` with true poses has 5 to 130 m
_SEEN = 0.9  # that a drone's segmenter finds a fire at all
WORSE, WORSE_BY = 0.12, (2.0, 5.0)  # the share of drones whose errors are larger than told, and how much
_HEADINGS_RAD = (math.radians(0.5), math.radians(2.0))  # with the scenery as a compass, and without
_RANGE_M = (1_000.0, 4_000.0)
_RANGE_SHARE = (0.02, 0.10)  # the range's standard deviation once it is as good as it gets
_FIRST_S, _NEXT_S = (
    40.0,
    8.0,
)  # by when a drone is there, and how long it takes to find the next fire in the same picture
_SETTLE_S = 15.0
_COMMON = math.sqrt(0.7)  # of a drone's error, what all its fires have in common


@dataclass(frozen=True, slots=True)
class Craft:
    """One drone: where it looks from (2,), its told sizes, the errors of its fires in their units, when it finds each.

    `errors` (F, 2) are along and across the line of sight in told standard deviations; `found_s` (F,) is endless where
    a fire is not found. `worse` is how many times larger than told they were drawn.
    """

    name: str
    position_en_m: FloatArray
    heading_rad: float
    range_share: float
    errors: FloatArray
    found_s: FloatArray
    worse: float


@dataclass(frozen=True, slots=True)
class Fleet:
    """Drones, the fires (F, 2), and the errors that all have in common: of position (2,), of each fire's aim (F, 2)."""

    crafts: tuple[Craft, ...]
    fires_en_m: FloatArray
    shared_en_m: FloatArray
    aims_en_m: FloatArray


def drawn(seed: int) -> Fleet:
    """Two to five drones about one fire or, every other seed, two."""
    rng = np.random.default_rng([seed, 21])
    count = 1 + seed % 2
    turn = rng.uniform(0.0, 2.0 * np.pi)
    fires = np.array([[0.0, 0.0], [APART_M * math.sin(turn), APART_M * math.cos(turn)]])[:count]
    middle, spread = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(np.pi / 3.0, 2.0 * np.pi)
    crafts = tuple(
        _craft(f"drone{number}", rng, fires, middle + spread * rng.uniform(-0.5, 0.5))
        for number in range(1, 1 + int(rng.integers(2, 6)))
    )
    return Fleet(crafts, fires, SHARED_M * rng.normal(size=2), AIM_M * rng.normal(size=(count, 2)))


def _craft(name: str, rng: np.random.Generator, fires: FloatArray, azimuth_rad: float) -> Craft:
    away_m = math.exp(rng.uniform(*np.log(_RANGE_M)))
    heading_rad = float(rng.choice(_HEADINGS_RAD))
    worse = float(rng.uniform(*WORSE_BY)) if rng.random() < WORSE else 1.0
    own = math.sqrt(1.0 - _COMMON**2)
    errors = worse * (_COMMON * rng.normal(size=2) + own * rng.normal(size=(len(fires), 2)))
    there_s = rng.uniform(0.0, _FIRST_S)
    found_s = there_s + np.where(rng.random(len(fires)) < _SEEN, rng.uniform(0.0, _NEXT_S, len(fires)), np.inf)
    if not np.isfinite(found_s).any():
        found_s[0] = there_s
    position = fires.mean(axis=0) + away_m * np.array([math.sin(azimuth_rad), math.cos(azimuth_rad)])
    range_share = math.exp(rng.uniform(*np.log(_RANGE_SHARE)))
    return Craft(name, position, heading_rad, range_share, errors, found_s, worse)


def reports(fleet: Fleet) -> Iterator[tuple[float, list[Claim]]]:
    """What all have confirmed by each time in seconds; each claim is named `CRAFT/FIRE`."""
    for step in range(STEPS):
        time_s = step * STEP_S
        yield (
            time_s,
            [
                _claim(craft, fleet, fire, time_s - craft.found_s[fire])
                for craft in fleet.crafts
                for fire in range(len(fleet.fires_en_m))
                if time_s >= craft.found_s[fire]
            ],
        )


def _claim(craft: Craft, fleet: Fleet, fire: int, known_s: float) -> Claim:
    to = fleet.fires_en_m[fire] - craft.position_en_m
    range_m = float(np.hypot(*to))
    along = to / range_m
    across = np.array([along[1], -along[0]])
    growth = 1.0 + 2.0 * math.exp(-known_s / _SETTLE_S)
    sizes = np.array([craft.range_share, craft.heading_rad]) * range_m * growth
    offset = sizes * craft.errors[fire]
    common = (SHARED_M**2 + AIM_M**2) * np.eye(2)
    covariance = np.outer(along, along) * sizes[0] ** 2 + np.outer(across, across) * sizes[1] ** 2 + common
    off = fleet.shared_en_m + fleet.aims_en_m[fire]
    position = fleet.fires_en_m[fire] + along * offset[0] + across * offset[1] + off
    reported = position - craft.position_en_m
    bearing_rad = math.atan2(reported[0], reported[1])
    shared = shared_part(covariance)
    return Claim(
        f"{craft.name}/{fire}", craft.name, position, covariance, shared, bearing_rad, float(np.hypot(*reported))
    )
