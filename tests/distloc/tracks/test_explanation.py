"""What is said of why a target is not confirmed."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.targets import Box
from distloc.tracks.estimates import reports
from distloc.tracks.explanation import Explanation, Lack, lacks_of
from distloc.tracks.life import TrackLife
from distloc.types import CameraPose, TargetState
from tests.support.cube_samples import CAMERA, R_NORTH, cube_mask, empty_mask, pose_at
from tests.support.far_things import FarThings


def located(**settings: object) -> Localizer:
    config = replace(LocalizerConfig(n_particles=2000), **settings)  # type: ignore[arg-type]
    return Localizer(CAMERA, config, rng=np.random.default_rng(0))


def test_a_target_is_explained_from_its_first_sighting_until_it_is_confirmed() -> None:
    localizer = located()
    assert localizer.explain() == Explanation(places=64, candidate_places=24)
    localizer.step(pose_at(0.0), cube_mask(pose_at(0.0)))
    (one,) = localizer.explain().tracks
    assert (one.id, one.state, one.sightings) == (None, None, 1)
    assert one.lacks == (Lack.SIGHTINGS, Lack.RANGE_UNBOUNDED) and "; " in one.words
    seen = []
    for k in range(1, 40):
        estimates = localizer.step(pose_at(10.0 * k), cube_mask(pose_at(10.0 * k)))
        said = localizer.explain()
        assert localizer.explain() is said
        (one,) = said.tracks
        if estimates:
            (told,) = estimates
            assert (one.id, one.state, one.range95_m) == (told.id, told.state, told.range95_m)
            assert (said.places_used, said.candidates) == (1, 0)
            assert one.lacks or told.state is TargetState.CONFIRMED
        seen.append(one.lacks)
    assert one.state is TargetState.CONFIRMED and one.lacks == () and one.words == ""
    assert any(Lack.RANGE_UNBOUNDED in lacks for lacks in seen) and any(lacks == (Lack.BASELINE,) for lacks in seen)


def test_where_many_wait_to_be_judged_none_is_confirmed_before_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    localizer = located()
    for steps, at_once, state, lacks in (
        (range(40), 0, TargetState.TENTATIVE, (Lack.MAY_MOVE,)),
        (range(40, 42), 1, TargetState.CONFIRMED, ()),
    ):
        monkeypatch.setattr(reports, "_JUDGED_AT_ONCE", at_once)
        for k in steps:
            localizer.step(pose_at(10.0 * k), cube_mask(pose_at(10.0 * k)))
        (one,) = localizer.explain().tracks
        assert (one.state, one.lacks) == (state, lacks)


def test_between_steps_and_with_nothing_in_view_nothing_is_said() -> None:
    localizer = located()
    for k in range(3):
        localizer.step(pose_at(10.0 * k), empty_mask())
    assert localizer.explain() == Explanation(places=64, candidate_places=24)


def test_a_hover_lacks_a_baseline_however_often_it_sees() -> None:
    localizer = located()
    for k in range(20):
        pose = CameraPose(float(k), np.array([0.0, 0.0, 250.0]), R_NORTH)  # the cube is lower
        localizer.step(pose, cube_mask(pose))
    (one,) = localizer.explain().tracks
    assert (one.state, one.sightings, one.lacks) == (TargetState.TENTATIVE, 12, (Lack.RANGE_UNBOUNDED,))
    assert "fly across" in one.words


def test_smoke_high_in_the_air_is_said_to_be_a_cloud() -> None:
    localizer, cloud = located(), Box(np.array([500.0, 2000.0, 800.0]))
    for k in range(40):
        mask = empty_mask()
        cloud.draw(mask, CAMERA, pose_at(20.0 * k))
        localizer.step(pose_at(20.0 * k), mask)
    (one,) = localizer.explain().tracks
    assert one.state is TargetState.TENTATIVE and one.lacks == (Lack.IN_THE_SKY,)


def test_what_waits_for_a_place_says_so_and_comes_last() -> None:
    things = FarThings(12, max_targets=4)
    for _ in range(40):
        things.step(has_fire=True)
    said = things.localizer.explain()
    assert (said.places, said.places_used, said.candidates) == (4, 4, len(said.tracks) - 4)
    first, *_ = said.tracks
    assert first.state is TargetState.CONFIRMED and first.lacks == ()
    assert [one.id is None for one in said.tracks] == [False] * 4 + [True] * said.candidates
    for one in said.tracks[4:]:
        assert one.lacks[0] is Lack.NO_PLACE and one.sightings == 12


def test_each_lack_has_words_of_its_own() -> None:
    assert all(lack.words for lack in Lack) and len({lack.words for lack in Lack}) == len(Lack)


@pytest.mark.parametrize(
    ("told", "lacks"),
    [
        ({}, []),
        ({"is_bounded": False}, [Lack.RANGE_UNBOUNDED]),
        ({"is_short": False}, [Lack.BASELINE]),
        ({"is_bounded": False, "is_short": False}, [Lack.RANGE_UNBOUNDED]),
        ({"is_awaited": True, "is_shared": True}, [Lack.SCENERY, Lack.TOO_CLOSE]),
        ({"is_standing": False}, [Lack.MAY_MOVE]),
    ],
)
def test_each_condition_of_a_confirmation_has_its_name(told: dict[str, bool], lacks: list[Lack]) -> None:
    life = TrackLife(1, 0.0, np.zeros(3))
    good = {"is_bounded": True, "is_short": True, "is_awaited": False, "is_shared": False, "is_standing": True}
    assert lacks_of(life, **good) == [Lack.SIGHTINGS]
    for k in range(8):
        life.sighting(True, float(k), np.zeros(3))
    assert lacks_of(life, **{**good, **told}) == lacks
    life.settle(True, 0.1)
    life.doubt()
    assert lacks_of(life, **good) == [Lack.CONTRADICTED]


def test_the_papers_filter_explains_its_one_target() -> None:
    localizer = located(filter="bootstrap")
    assert localizer.explain() == Explanation(places=1)
    for k in range(4):
        (told,) = localizer.step(pose_at(10.0 * k), cube_mask(pose_at(10.0 * k)))
    said = localizer.explain()
    (one,) = said.tracks
    assert (one.id, one.state, one.lacks, said.places_used) == (1, told.state, (Lack.SIGHTINGS,), 1)
    assert one.range95_m == pytest.approx(told.range95_m)
