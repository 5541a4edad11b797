"""Fires of simulated networks of towers: does the region hold where they began, and is nothing told that is unknown?"""

import math
from dataclasses import replace

import numpy as np
import pytest

from distloc.batch.sighting import Sighting, direction_from_azimuth
from distloc.batch.smoke import smoke_offset_m
from distloc.study.ignitions.biases import biases_for
from distloc.study.ignitions.known import Ignition, KnownFire, looks_of
from distloc.study.ignitions.scored import Answer, Overall, Scored, overall, scored
from distloc.types import PoseErrors
from tests.support.tower_networks import Season, season

SMOKE_M = 200.0
TOWERS = PoseErrors(math.radians(3.0), math.radians(1.0), math.radians(0.1), 1.0, 1e9)


def both_ways(fires: list[KnownFire], errors: PoseErrors = TOWERS) -> tuple[list[Scored], list[Scored]]:
    """By nominal biases, and by those that the other fires tell."""
    looks = looks_of(fires, SMOKE_M)
    by_estimated = []
    for fire in fires:
        others = [look for look in looks if look.fire != fire.name]
        stamp_s = float(np.median([one.stamp_s or 0.0 for one in fire.sightings]))
        biases = biases_for([look.platform for look in looks], stamp_s, others, errors.heading_bias_rad)
        by_estimated.append(scored(fire, errors, SMOKE_M, biases=biases))
    return [scored(fire, errors, SMOKE_M) for fire in fires], by_estimated


def pooled(seeds: range, of: Season, errors: PoseErrors = TOWERS) -> tuple[Overall, Overall]:
    ways = [both_ways(season(np.random.default_rng([31, seed]), of), errors) for seed in seeds]
    return overall([one for way, _ in ways for one in way]), overall([one for _, way in ways for one in way])


def test_a_season_is_covered() -> None:
    nominal, estimated = pooled(range(200, 201), Season(fires=12, looks=6))
    for one in (nominal, estimated):
        assert one.fires >= 8 and one.abstained < 0.4
        assert one.held >= one.located - 2


@pytest.mark.thorough
def test_ten_seasons_are_covered_and_other_fires_make_the_region_smaller() -> None:
    nominal, estimated = pooled(range(300, 310), Season())
    for one in (nominal, estimated):
        assert 0.9 <= one.coverage <= 0.99
        assert one.abstained < 0.15
    assert estimated.area_km2 < 0.85 * nominal.area_km2
    assert estimated.error_m < nominal.error_m


@pytest.mark.thorough
def test_seasons_in_strong_wind_of_well_kept_cameras_are_covered() -> None:
    """The smoke errs more than the compass: what is found of it must be in the region."""
    errors = replace(TOWERS, heading_bias_rad=math.radians(0.5))
    for one in pooled(range(320, 325), Season(heading_bias_deg=0.5, wind_mps=8.0), errors):
        assert one.coverage >= 0.88


def seen_from(name: str, lon: float, azimuth_deg: float, count: int = 5) -> list[Sighting]:
    direction = direction_from_azimuth(math.radians(azimuth_deg), 0.0)
    one = Sighting(47.0, lon, 500.0, direction, sigma_rad=(2e-3, 0.17), platform=name, target="f")
    return [replace(one, stamp_s=60.0 * i) for i in range(count)]


def answer_of(*groups: list[Sighting]) -> Answer:
    sightings = tuple(one for group in groups for one in group)
    return scored(KnownFire("f", sightings, Ignition(47.1, 8.1)), TOWERS, SMOKE_M).answer


def test_abstentions_say_why() -> None:
    a, b = seen_from("a", 8.0, 45.0), seen_from("b", 8.2, -45.0)
    assert answer_of(a, b) is Answer.LOCATED
    assert answer_of(a) is Answer.BEARING
    assert answer_of(a, seen_from("b", 8.02, 43.0)) in (Answer.BEARING, Answer.ROUGH)  # all but parallel
    # a third that looks the other way: any two of three cross somewhere, and two to one is no majority
    assert answer_of(a, b, seen_from("c", 8.1, 120.0)) is Answer.DISAGREE


def test_an_ignition_s_own_error_is_allowed_for() -> None:
    sightings = tuple(seen_from("a", 8.0, 45.0) + seen_from("b", 8.2, -45.0))
    place = scored(KnownFire("f", sightings, Ignition(47.1, 8.1)), TOWERS, SMOKE_M)
    assert place.ellipse95 is not None and place.lat_deg is not None and place.lon_deg is not None
    beyond_deg = 1.3 * place.ellipse95.semi_major_m / 111_320.0
    for sigma_m, holds in ((0.0, False), (2.0 * place.ellipse95.semi_major_m, True)):
        truth = Ignition(place.lat_deg + beyond_deg, place.lon_deg, sigma_m)
        again = scored(KnownFire("f", sightings, truth), TOWERS, SMOKE_M)
        assert again.holds is holds and again.area_km2 == place.area_km2
        assert again.error_m == pytest.approx(beyond_deg * 111_320.0, rel=0.01)


def test_the_biases_are_taken_off_the_headings() -> None:
    """Two towers that both look 4 degrees to the right, and are known to do so."""
    sightings = tuple(seen_from("a", 8.0, 49.0) + seen_from("b", 8.2, -41.0))
    truth = Ignition(47.0 + 0.1 * math.cos(math.radians(47.0)), 8.1)
    fires = [KnownFire(str(day), sightings, truth) for day in range(5)]
    nominal, estimated = both_ways(fires)
    assert nominal[0].error_m is not None and estimated[0].error_m is not None
    assert estimated[0].error_m < 0.25 * nominal[0].error_m


def test_smoke_that_spreads_and_wanders_widens_the_region() -> None:
    still = seen_from("a", 8.0, 45.0)
    wide = [replace(one, sigma_rad=(0.03, 0.17)) for one in still]
    walks = [
        replace(one, direction_enu=direction_from_azimuth(math.radians(45.0 + 0.5 * i), 0.0))
        for i, one in enumerate(still)
    ]
    assert smoke_offset_m([still], [10e3], SMOKE_M) == SMOKE_M
    assert smoke_offset_m([wide], [10e3], SMOKE_M) == pytest.approx(10e3 * 0.03 * math.sqrt(3.0))
    assert smoke_offset_m([walks], [10e3], 1.0) == pytest.approx(10e3 * math.radians(0.5) * 1.4826, rel=0.05)
