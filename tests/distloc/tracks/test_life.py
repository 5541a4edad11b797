import numpy as np
import pytest

from distloc.tracks.life import CONFIRM_SIGHTINGS, CONFIRM_WINDOW, LOCATED_SHARE, TrackLife
from distloc.types import TargetState


def track_with(*matches: bool, share: float = 0.1) -> TrackLife:
    track = TrackLife(1, 0.0, np.zeros(3))
    for stamp, is_match in enumerate(matches):
        track.sighting(is_match, float(stamp), np.array([10.0 * stamp, 0.0, 0.0]))
        track.settle(is_match, share)
    return track


def test_confirmed_at_the_eighth_sighting_and_not_before() -> None:
    assert track_with(*[True] * (CONFIRM_SIGHTINGS - 1)).state is TargetState.TENTATIVE
    assert track_with(*[True] * CONFIRM_SIGHTINGS).state is TargetState.CONFIRMED


def test_sightings_outside_the_window_do_not_count() -> None:
    enough = [True] * 7 + [False] * 4 + [True]
    assert len(enough) == CONFIRM_WINDOW
    assert track_with(*enough).state is TargetState.CONFIRMED
    assert track_with(*[True] * 7, *[False] * 5, True).state is TargetState.TENTATIVE


@pytest.mark.parametrize(("share", "state"), [(LOCATED_SHARE, "confirmed"), (LOCATED_SHARE + 0.01, "tentative")])
def test_confirmed_only_once_located(share: float, state: str) -> None:
    assert track_with(*[True] * 12, share=share).state == state


def test_coasts_and_comes_back() -> None:
    track = track_with(*[True] * 8, False)
    assert track.state is TargetState.COASTING
    track.settle(True, 0.9)
    assert track.state is TargetState.CONFIRMED


def test_counts_stamps_and_baseline() -> None:
    track = track_with(True, True, True, False, False)
    assert (track.observations, track.misses) == (3, 2)
    assert (track.first_seen_s, track.last_seen_s) == (0.0, 2.0)
    assert track.baseline_m == 20.0  # a miss does not lengthen it
    track.sighting(True, 9.0, np.zeros(3))
    assert (track.misses, track.baseline_m) == (0, 20.0)


def test_existence_by_laplaces_rule() -> None:
    assert TrackLife(1, 0.0, np.zeros(3)).existence == 0.5
    assert track_with(True, True, False).existence == pytest.approx(3 / 5)
    assert track_with(*[True] * 30).existence == pytest.approx(13 / 14)
    assert track_with(*[True] * 12, *[False] * 12).existence == pytest.approx(1 / 14)


def test_each_doubt_doubles_what_it_takes_and_long_agreement_halves_it() -> None:
    track = TrackLife(1, 0.0, np.zeros(3))

    def steps_to_confirm() -> int:
        for count in range(1, 200):
            track.sighting(True, 0.0, np.zeros(3))
            track.settle(True, 0.1)
            if track.state is TargetState.CONFIRMED:
                return count
        return 200

    taken = [steps_to_confirm()]
    for _ in range(6):
        track.doubt()
        track.doubt()  # the same contradiction, still in memory, counts once
        taken.append(steps_to_confirm())
    assert taken[:3] == [8, 16, 32]
    assert max(taken) <= 128
    for _ in range(240):
        track.sighting(True, 0.0, np.zeros(3))
    track.doubt()
    assert steps_to_confirm() <= 32


def test_sightings_of_another_stay_in_view_do_not_confirm() -> None:
    track = TrackLife(1, 0.0, np.zeros(3))
    for k in range(12):
        track.sighting(True, float(k), np.zeros(3))
        track.settle(True, 0.9)  # its ellipse is too long
    assert track.state is TargetState.TENTATIVE
    track.come_back()  # after minutes out of view: what is there now may be a bird
    for k in range(4):
        track.sighting(True, 250.0 + k, np.zeros(3))
        track.settle(True, 0.1)
        assert (track.state is TargetState.CONFIRMED) == (k == 3)
    track.come_back()  # what was confirmed is taken up at once
    track.sighting(True, 500.0, np.zeros(3))
    track.settle(True, 0.1)
    assert track.state is TargetState.CONFIRMED and track.sightings == 12


@pytest.mark.parametrize(("after_s", "is_burst"), [(24.0, True), (26.0, False)])
def test_a_burst_is_one_short_while(after_s: float, is_burst: bool) -> None:
    track = TrackLife(1, 100.0, np.zeros(3))
    track.sighting(True, 100.0 + after_s, np.zeros(3))
    assert track.is_burst is is_burst
