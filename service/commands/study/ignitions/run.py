"""`study fires`: each fire located without its ignition, by nominal and by estimated biases, and compared with it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.filter.ground import Ground
from distloc.geometry.geodesy import LocalFrame
from distloc.study.ignitions.biases import Bias, biases_for
from distloc.study.ignitions.known import KnownFire, Look, looks_of
from distloc.study.ignitions.scored import Scored, overall, scored
from distloc.types import PoseErrors
from service.commands.progress import count_progress
from service.commands.study.files import prepared
from service.commands.study.ignitions import table
from service.commands.study.ignitions.known import IGNITION_COLUMNS, fires_of, ignitions_of
from service.recordings.sightings.reading import SightingsError
from service.recordings.sightings.wanted import Wanted, ground_of, read_sightings

_FOR_GOOD_S = 1e9
_MOST_TOLD = 50


@dataclass(frozen=True, slots=True)
class Nominal:
    """Sizes of the errors of rows that bring none: one standard deviation."""

    heading_bias_deg: float = 3.0
    tilt_bias_deg: float = 1.0
    smoke_offset_m: float = 200.0

    def errors(self) -> PoseErrors:
        """Of a fixed mount."""
        heading_rad, tilt_rad = math.radians(self.heading_bias_deg), math.radians(self.tilt_bias_deg)
        return PoseErrors(heading_rad, tilt_rad, math.radians(0.1), 1.0, _FOR_GOOD_S)


def run_fires(
    paths: list[Path],
    ignitions: Path | None,
    wanted: Wanted,
    nominal: Nominal,
    say: Callable[[str], None],
    warn: Callable[[str], None],
) -> None:
    """Print the fires and what is true of all, write both and the biases; SightingsError where there is no fire."""
    out = wanted.out or Path("study/fires")
    tables, found = read_sightings(paths, wanted, warn, IGNITION_COLUMNS)
    known = ignitions_of(tables, ignitions)
    fires, lines = fires_of(found.sightings, found.where, known)
    for line in [*known.faults, *lines]:
        warn(f"note: {line}")
    if not fires:
        raise SightingsError(f"{paths[0]}: no fire has both sightings and a known ignition: are their names the same?")
    prepared(out)
    looks = looks_of(fires, nominal.smoke_offset_m)
    ground = _kept(ground_of(wanted, found, _once(warn)))
    by_nominal, by_estimated = _located(fires, looks, nominal, ground, wanted.range_m)
    for line in table.printed(by_nominal, by_estimated):
        say(line)
    told_rad = math.radians(nominal.heading_bias_deg)
    names = table.written(out, by_nominal, by_estimated, _all_biases(looks, told_rad), overall)
    say(f"wrote {out}/{', '.join(names)}")


def _once(warn: Callable[[str], None]) -> Callable[[str], None]:
    """Each line once, not for each fire."""
    told: set[str] = set()

    def tell(line: str) -> None:
        if line not in told and len(told) < _MOST_TOLD:
            told.add(line)
            warn(line)

    return tell


def _kept(ground: Callable[[LocalFrame], Ground] | None) -> Callable[[LocalFrame], Ground] | None:
    """The same, that remembers the last: a fire's cameras are located by twice."""
    if ground is None:
        return None
    last: dict[tuple[float, float, float], Ground] = {}

    def of_frame(frame: LocalFrame) -> Ground:
        if frame.origin not in last:
            found = ground(frame)
            last.clear()
            last[frame.origin] = found
        return last[frame.origin]

    return of_frame


def _located(
    fires: Sequence[KnownFire],
    looks: Sequence[Look],
    nominal: Nominal,
    ground: Callable[[LocalFrame], Ground] | None,
    range_m: tuple[float, float],
) -> tuple[list[Scored], list[Scored]]:
    errors, least_m = nominal.errors(), nominal.smoke_offset_m
    by_nominal, by_estimated = [], []
    with count_progress("fires", len(fires)) as on_done:
        for number, fire in enumerate(fires, 1):
            by_nominal.append(scored(fire, errors, least_m, ground, range_m))
            others = [look for look in looks if look.fire != fire.name]
            biases = _biases(fire, others, errors.heading_bias_rad)
            by_estimated.append(scored(fire, errors, least_m, ground, range_m, biases))
            on_done(number)
    return by_nominal, by_estimated


def _biases(fire: KnownFire, others: Sequence[Look], told_rad: float) -> dict[str, Bias]:
    """Of its fixed mounts, by all other fires: the one that is scored has no say."""
    stamps = [one.stamp_s for one in fire.sightings if one.stamp_s is not None]
    platforms = sorted({one.platform for one in fire.sightings})
    return biases_for(platforms, float(np.median(stamps)) if stamps else 0.0, others, told_rad)


def _all_biases(looks: Sequence[Look], told_rad: float) -> dict[str, Bias]:
    """Of each mount by all the fires that it saw, at the last of them."""
    last_s = {name: max(one.stamp_s for one in looks if one.platform == name) for name in {o.platform for o in looks}}
    return {name: biases_for([name], last_s[name], looks, told_rad)[name] for name in sorted(last_s)}
