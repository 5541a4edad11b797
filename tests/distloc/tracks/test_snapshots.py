"""Snapshots of what clocks, platforms and autopilots may legally do: none is refused, and each can be restored."""

from collections.abc import Iterator, Sequence

import numpy as np
import pytest

from distloc.localizer import Localizer, LocalizerConfig
from distloc.scenery.compass import Compass
from distloc.tracks.motion.bearings import AGE, AZIMUTH
from distloc.tracks.tracker import Tracker
from distloc.types import CameraPose, Detection, FloatArray
from tests.support.towers import CAMERA, looking_at

FIRE_M = np.array([0.0, 3000.0, 0.0])
AWAY_M = np.array([0.0, -9000.0, 0.0])
Step = tuple[CameraPose, list[Detection]]


def localizer(platforms: int = 2, compass: Compass | None = None) -> Localizer:
    config = LocalizerConfig(platforms=platforms, n_particles=1000)
    return Localizer(CAMERA, config, rng=np.random.default_rng(0), compass=compass)


def seen(k: int, stamp_s: float, platform: str = "a", fires_m: Sequence[FloatArray] = (FIRE_M,)) -> Step:
    """What a camera sees that has come 15 m farther east at each step; the second platform's is 300 m farther south."""
    place_m = np.array([15.0 * k, -300.0 if platform == "b" else 0.0, 300.0])
    towards_m = fires_m[len(fires_m) // 2] if fires_m else AWAY_M
    R = looking_at(place_m, towards_m)
    pixels = [CAMERA.project((R @ (fire_m - place_m))[:, None])[0][:, 0].tolist() for fire_m in fires_m]
    detections = [Detection.from_point(*pixel, 3.0) for pixel in pixels]
    return CameraPose(stamp_s, place_m, R, heading_rad=np.pi / 2.0, platform=platform), detections


def goes_back() -> Iterator[Step]:
    return (seen(k, float(k if k < 20 else k - 100)) for k in range(40))


def cross() -> Iterator[Step]:
    """The second platform's stamps are 20 ms behind."""
    for k in range(20):
        yield seen(k, float(k), "a")
        yield seen(k, k - 0.02, "b")


@pytest.mark.parametrize("flight", [goes_back, cross])
def test_time_need_not_rise(flight: object) -> None:
    located = localizer()
    for step in flight():  # type: ignore[operator]
        told = located.step_detections(*step)
        saved = located.snapshot()
    again = localizer()
    again.restore(saved)
    for k in range(8):
        for one in again.step_detections(*seen(40 + k, 50.0 + k)):
            assert np.isfinite(one.position_enu_m).all() and np.isfinite(one.covariance_enu_m2).all()
            assert one.id == told[0].id
    again.snapshot()


def test_who_never_looked_may_be_doubted_and_jump() -> None:
    for tell in (Localizer.doubt_attitude, lambda located, name: located.heading_jumped(0.1, name)):
        located, plain = localizer(), localizer()
        for k in range(12):
            located.step_detections(*seen(k, float(k)))
            plain.step_detections(*seen(k, float(k)))
        tell(located, "b")
        saved, was = located.snapshot(), plain.snapshot()
        assert saved.platform == "a"
        assert saved.tracks[0].filter.nuisances.tolist() == was.tracks[0].filter.nuisances.tolist()
        assert saved.tracks[0].bearings.tolist() == was.tracks[0].bearings.tolist()


def test_who_is_told_of_before_the_first_step_takes_no_place() -> None:
    located = localizer()
    located.doubt_attitude("b")
    for k in range(6):
        located.step_detections(*seen(k, float(k), "a"))
        located.step_detections(*seen(k, float(k), "b"))
    assert len(located.snapshot().tracks) == 1


def test_what_is_reported_in_a_step_of_who_never_saw_it_has_that_ones_error() -> None:
    """Of eight targets four are reported at once, the others in the step of a second camera, which looks elsewhere."""
    fires_m = [np.array([x_m, 3000.0, 0.0]) for x_m in np.linspace(-1200.0, 1200.0, 8)]
    located, reported = localizer(), set()
    tracker = located._tracker
    assert isinstance(tracker, Tracker)
    for k in range(8):
        located.step_detections(*seen(k, float(k), "a", fires_m))
        told = located.step_detections(*seen(k, k + 0.5, "b", ()))
        reported.add(len(told))
        assert len(located.snapshot().tracks) == len(told)
        for track in tracker._tracks:
            errors = LocalizerConfig().pose_errors.bias_variance
            assert tracker._bank.P[track.filter.place, :3, :3] == pytest.approx(errors, rel=1e-6)
    assert 8 in reported


class UsedCompass(Compass):
    """Corrects the pose, as far as anyone can tell."""

    is_used = True  # type: ignore[assignment]


def test_with_the_scenerys_attitude_the_autopilots_bearings_still_hear_of_it() -> None:
    located = localizer(1, UsedCompass(CAMERA, 10.0, 1.0))
    for k in range(12):
        located.step_detections(*seen(k, float(k)))
    (was,) = located.snapshot().tracks
    located.heading_jumped(0.2)
    located.doubt_attitude()
    (now,) = located.snapshot().tracks
    assert now.bearings[:, AZIMUTH] == pytest.approx(was.bearings[:, AZIMUTH] + 0.2)
    assert now.filter.nuisances.tolist() == was.filter.nuisances.tolist()
    assert now.filter.nuisance_covariance.tolist() == was.filter.nuisance_covariance.tolist()
    located.step_detections(*seen(12, 12.0))
    (later,) = located.snapshot().tracks
    assert later.bearings[-1, AGE] - later.bearings[-2, AGE] > 5.0  # one error before, another since
