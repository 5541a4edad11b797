"""Places from sightings: is the truth in the ellipse, whatever the order, and is nothing told that is not known?"""

import math
from dataclasses import replace

import numpy as np
import pytest

from distloc.batch.belonging.members import least_squares
from distloc.batch.lines import lines_of
from distloc.batch.locate import locate
from distloc.batch.place import Located, Place, Unused
from distloc.batch.sighting import Sighting, direction_from_azimuth
from distloc.filter.uncertainty import ellipse_holds
from distloc.types import FloatArray
from tests.support.sightings import FRAME, of_towers, seen, stills, survey, tower_errors
from tests.support.towers import FIRE_ENU_M, Towers, area_m2

LOOKS = 5
STILL_ERRORS = replace(tower_errors(0.5, 1.8), position_m=0.3, position_bias_m=0.3, bias_time_constant_s=120.0)
STILL_ERRORS = replace(STILL_ERRORS, bias_turn_rad=math.radians(115.0))


def offset_m(place: Place, truth_enu_m: FloatArray) -> FloatArray:
    """East, north and up from where a place is said to be to where it is."""
    assert place.lat_deg is not None and place.lon_deg is not None and place.height_m is not None
    return np.asarray(truth_enu_m - FRAME.enu_from_geodetic(place.lat_deg, place.lon_deg, place.height_m))


def holds(place: Place, truth_enu_m: FloatArray) -> bool:
    assert place.ellipse95 is not None
    return ellipse_holds(place.ellipse95, offset_m(place, truth_enu_m)[:2])


def fire_of(sightings: list[Sighting]) -> Place:
    """The one place, of all sightings."""
    (place,) = locate(sightings).places
    assert len(place.used) == len(sightings)
    return place


def told_of_sets(seeds: range) -> tuple[float, list[float]]:
    """Of tower sets the share that is inside, and each ellipse's area by that of the bound; of all sightings few go."""
    inside, shares, used, given = 0, [], 0, 0
    for seed in seeds:
        rng = np.random.default_rng([9, seed])
        towers = Towers.drawn(rng, 4)
        sightings = of_towers(towers, rng, LOOKS)
        (place,) = locate(sightings).places
        used, given = used + len(place.used), given + len(sightings)
        assert place.ellipse95 is not None
        inside += holds(place, FIRE_ENU_M)
        area = math.pi * place.ellipse95.semi_major_m * place.ellipse95.semi_minor_m
        shares.append(area / area_m2(towers.bound_m2(LOOKS)))
    assert used >= 0.99 * given  # what errs by over three sigma may be left out
    return inside / len(seeds), shares


def four_towers(seed: int = 4) -> list[Sighting]:
    rng = np.random.default_rng(seed)
    towers = Towers.drawn(rng, 4)
    towers.biases_rad[:] = 0.0
    towers.biases_rad[:, 2] = np.radians([1.5, -1.4, 4.5, 1.6])
    return of_towers(towers, rng, LOOKS)


def test_each_tower_errs_in_its_own_way() -> None:
    place = fire_of(four_towers())
    assert holds(place, FIRE_ENU_M)
    assert place.platforms == ("tower0", "tower1", "tower2", "tower3")
    assert place.further is not None and place.ellipse95 is not None
    assert place.further.ellipse95.semi_major_m < place.ellipse95.semi_major_m
    # taken as one platform's they would be sure of what is wrong: so a name that is in several places is several
    one_name = locate([replace(one, platform="all") for one in four_towers()])
    assert "in 4 places at once" in one_name.notes[0]
    assert one_name.places[0].position_enu_m == pytest.approx(place.position_enu_m)


def test_the_ellipse_is_as_large_as_the_batch_bound_s() -> None:
    inside, shares = told_of_sets(range(10))
    assert inside >= 0.8
    assert 0.8 < float(np.median(shares)) < 1.3


@pytest.mark.thorough
def test_two_hundred_sets_of_towers() -> None:
    inside, shares = told_of_sets(range(1000, 1200))
    assert 0.9 <= inside <= 1.0
    assert 0.9 < float(np.median(shares)) < 1.3


def test_the_order_of_the_rows_changes_nothing() -> None:
    sightings = four_towers()
    first = locate(sightings)
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(sightings)).tolist()
        again = locate([sightings[i] for i in order])
        assert np.array_equal(first.places[0].position_enu_m, again.places[0].position_enu_m)  # type: ignore[arg-type]
        assert first.places[0].ellipse95 == again.places[0].ellipse95
        assert sorted(order[i] for i in again.places[0].used) == list(first.places[0].used)


@pytest.mark.parametrize("tilt_deg", [0.5, 2.0, 5.0])
def test_two_views_20_km_apart_are_of_one_place(tilt_deg: float) -> None:
    errors = replace(tower_errors(tilt_deg, 2.0), bias_time_constant_s=120.0)
    for seed in range(4):
        rng = np.random.default_rng([3, seed])
        views = [
            seen(
                np.array(at),
                FIRE_ENU_M,
                rng.standard_normal(3) * np.radians([tilt_deg, tilt_deg, 2.0]),
                platform=name,
                stamp_s=stamp_s,
                errors=errors,
                sigma_rad=(2e-3, 2e-3),
            )
            for name, at, stamp_s in (("a", (-10e3, -17.3e3, 500.0), 0.0), ("b", (10e3, -17.3e3, 600.0), 30.0))
        ]
        one, other = fire_of(views), fire_of(views[::-1])
        assert one.ellipse95 == other.ellipse95
        assert one.ellipse95 is not None and one.ellipse95.semi_major_m < 5e3


def test_three_stills_give_an_answer() -> None:
    sightings = stills(np.random.default_rng(2), 3)
    located = locate(sightings, errors=STILL_ERRORS)
    assert len(located.places[0].used) == 3 and located.places[0].is_bounded


def test_headings_that_jump_are_found_to_do_so() -> None:
    found = []
    for white_deg in (0.0, 1.6):
        place = locate(stills(np.random.default_rng(7), 20, white_deg=white_deg), errors=STILL_ERRORS).places[0]
        assert len(place.used) == 20
        found.append(place.heading_white_rad)
    assert found[0] < math.radians(0.3) < math.radians(0.5) < found[1]


def test_one_sighting_is_a_bearing() -> None:
    (place,) = locate([Sighting(47.0, 8.0, 500.0, direction_from_azimuth(math.radians(30.0), 0.0))]).places
    assert not place.is_bounded and place.ellipse95 is None and place.lat_deg is None
    assert math.degrees(place.bearing.azimuth_rad) == pytest.approx(30.0, abs=0.1)
    assert math.degrees(place.bearing.azimuth95_rad) == pytest.approx(1.96 * 2.0, rel=0.15)  # the compass, twice
    assert place.bearing.range95_m[1] == math.inf


def named(located: Located) -> dict[int, Unused]:
    return {one.index: one.reason for one in located.rejected}


def test_a_sighting_of_something_else_is_named() -> None:
    sightings = four_towers()
    wrong = sightings[6]
    turned = direction_from_azimuth(wrong.azimuth_rad + math.radians(25.0), wrong.elevation_rad)
    sightings[6] = replace(wrong, direction_enu=turned, target="fire")
    sightings = [replace(one, target="fire") for one in sightings]
    located = locate(sightings)
    assert named(located) == {6: Unused.MISFIT}
    assert located.rejected[0].beside_deg == pytest.approx(25.0, abs=6.0)
    assert holds(located.places[0], FIRE_ENU_M)


def test_a_sighting_twice_counts_once() -> None:
    sightings = four_towers()
    located = locate([*sightings, sightings[3]])
    assert named(located) == {20: Unused.DUPLICATE} and located.rejected[0].other == 3
    assert located.places[0].ellipse95 == locate(sightings).places[0].ellipse95


def test_two_fires_are_told_apart_without_names() -> None:
    rng = np.random.default_rng(11)
    other_enu_m = FIRE_ENU_M + np.array([3000.0, 1500.0, 100.0])
    biases = {name: rng.standard_normal(3) * np.radians([0.5, 0.5, 2.0]) for name in "abc"}
    places = {"a": (-9e3, -8e3, 500.0), "b": (10e3, -7e3, 600.0), "c": (1e3, 12e3, 700.0)}
    sightings, truth = [], []
    for look in range(4):
        for name, at in places.items():
            for which, fire in enumerate((FIRE_ENU_M, other_enu_m)):
                off_rad = biases[name] + 1e-3 * rng.standard_normal(3)
                sightings.append(
                    seen(np.array(at), fire, off_rad, platform=name, stamp_s=60.0 * look, sigma_rad=(1e-3, 1e-3))
                )
                truth.append(which)
    located = locate(sightings, errors=tower_errors(0.5, 2.0))
    assert len(located.places) == 2
    for place in located.places:
        (which,) = {truth[i] for i in place.used}
        assert len(place.used) == 12
        assert holds(place, (FIRE_ENU_M, other_enu_m)[which])


def test_what_other_targets_tell_of_the_compass_is_used() -> None:
    rng = np.random.default_rng(8)
    others = [FIRE_ENU_M + np.array([900.0 * j, 700.0 * (j % 2), 0.0]) for j in range(5)]
    towers = Towers.drawn(rng, 4, 0.3, 1.0)
    sightings = [
        seen(
            towers.places_enu_m[tower],
            fire,
            towers.biases_rad[tower] + 1e-3 * rng.standard_normal(3),
            platform=f"tower{tower}",
            stamp_s=60.0 * look,
            target=str(number),
            errors=towers.errors,
            sigma_rad=(1e-3, 1e-3),
        )
        for number, fire in enumerate(others)
        for look in range(3)
        for tower in range(4)
    ]
    together = locate(sightings)
    alone = locate([one for one in sightings if one.target == "0"])
    assert together.places[0].ellipse95 is not None and alone.places[0].ellipse95 is not None
    assert together.places[0].ellipse95.semi_major_m < 0.8 * alone.places[0].ellipse95.semi_major_m
    for place, fire in zip(together.places, others, strict=True):
        assert holds(place, fire)
    again = locate(sightings[::-1])
    assert [place.ellipse95 for place in again.places] == [place.ellipse95 for place in together.places]


def test_two_lines_each_of_two_things_are_not_paired_by_chance() -> None:
    rng = np.random.default_rng(2)
    cameras = (np.array([-9e3, -8e3, 500.0]), np.array([10e3, -7e3, 600.0]))
    fires = (FIRE_ENU_M, FIRE_ENU_M + np.array([2500.0, 0.0, 0.0]))
    sightings = [
        seen(camera, fire, 5e-3 * rng.standard_normal(3), platform=name, stamp_s=0.0)
        for name, camera in zip("ab", cameras, strict=True)
        for fire in fires
    ]
    assert set(named(locate(sightings)).values()) == {Unused.AMBIGUOUS}
    labelled = [replace(one, target=str(i % 2)) for i, one in enumerate(sightings)]
    assert len(locate(labelled).places) == 2


def test_where_no_two_agree_none_is_preferred() -> None:
    pair = [
        Sighting(47.0, 8.0, 500.0, direction_from_azimuth(azimuth, 0.0), platform=name, target="x")
        for name, azimuth in (("a", 0.0), ("b", math.pi))
    ]
    pair[1] = replace(pair[1], lat_deg=47.1)  # looks away from the first's camera and line
    pair[1] = replace(pair[1], direction_enu=direction_from_azimuth(0.5 * math.pi, 0.0))
    pair[0] = replace(pair[0], direction_enu=direction_from_azimuth(1.5 * math.pi, 0.0))
    located = locate(pair)
    assert [place.used for place in located.places] == [(0,), (1,)]
    assert not any(place.is_bounded for place in located.places)
    assert "no two of 2 sightings agree" in located.notes[0]


def test_what_can_be_no_sighting_is_refused() -> None:
    good = Sighting(47.0, 8.0, 500.0, direction_from_azimuth(0.0, 0.0))
    for key, value, says in (
        ("lat_deg", 91.0, "lat"),
        ("height_m", math.nan, "within 50 km"),
        ("direction_enu", np.array([0.0, 2.0, 0.0]), "unit vector"),
        ("sigma_rad", (-0.1, 0.0), "sigmas"),
        ("stamp_s", math.inf, "finite"),
    ):
        with pytest.raises(ValueError, match=says):
            replace(good, **{key: value})
    with pytest.raises(ValueError, match="1 to 100000 sightings, got 0"):
        locate([])
    with pytest.raises(ValueError, match="range_m"):
        locate([good], range_m=(100.0, 10.0))


@pytest.mark.thorough
def test_surveyed_points_in_stills_are_covered_and_beat_least_squares() -> None:
    inside, errors_m, plain_m = [], [], []
    for seed in range(30, 36):
        sightings, points = survey(np.random.default_rng([8, seed]), 16)
        located = locate(sightings, errors=STILL_ERRORS)
        for place in located.places:
            if not place.is_bounded:
                continue
            point = points[int(place.target)]
            inside.append(holds(place, point))
            errors_m.append(float(np.hypot(*offset_m(place, point)[:2])))
            own = [sightings[i] for i in place.used]
            nearest = least_squares(lines_of(own, [""] * len(own), located.frame, STILL_ERRORS), np.ones(len(own)))
            assert nearest is not None
            beside = FRAME.enu_from_geodetic(*located.frame.geodetic_from_enu(nearest)) - point
            plain_m.append(float(np.hypot(*beside[:2])))
    assert len(inside) > 90
    assert 0.9 <= float(np.mean(inside)) <= 1.0
    assert float(np.median(errors_m)) < 0.6 * float(np.median(plain_m))
