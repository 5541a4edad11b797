import numpy as np
import pytest

from distloc.localizer import Localizer, LocalizerConfig
from distloc.sights.detections import detections_from_mask
from distloc.types import CameraPose, TargetEstimate, TargetState
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, cube_mask, empty_mask, mask_elsewhere, pose_at

CONFIG = LocalizerConfig(filter="bootstrap", n_particles=10_000)


def localizer(seed: int = 0, config: LocalizerConfig = CONFIG) -> Localizer:
    return Localizer(CAMERA, config, rng=np.random.default_rng(seed))


def flown(located: Localizer, until_m: float) -> list[TargetEstimate]:
    stations_m = np.arange(0.0, until_m + 1.0, 10.0)
    return [estimate for east_m in stations_m for estimate in located.step(pose_at(east_m), cube_mask(pose_at(east_m)))]


def test_tentative_then_confirmed_then_coasting() -> None:
    located = localizer()
    estimates = flown(located, 500.0)
    states = [estimate.state for estimate in estimates]
    assert set(states[:7]) == {TargetState.TENTATIVE}
    assert states[-1] is TargetState.CONFIRMED
    assert {estimate.id for estimate in estimates} == {1}
    looking_south = np.diag([-1.0, 1.0, -1.0]) @ R_NORTH
    (away,) = located.step(CameraPose(51.0, np.array([510.0, 0.0, 0.0]), looking_south), empty_mask())
    assert away.state is TargetState.COASTING
    assert (away.misses, away.last_seen_s) == (0, 50.0)  # out of view is no miss
    (back,) = located.step(pose_at(520.0), cube_mask(pose_at(520.0)))
    assert back.state is TargetState.CONFIRMED


def test_estimate_of_the_cube() -> None:
    estimate = flown(localizer(), 800.0)[-1]
    offset = CUBE_ENU_M - np.array([800.0, 0.0, 0.0])
    assert np.linalg.norm(estimate.position_enu_m - CUBE_ENU_M) < 150.0
    assert estimate.range_m == pytest.approx(np.linalg.norm(offset), rel=0.07)
    assert estimate.range95_m[0] < estimate.range_m < estimate.range95_m[1]
    assert estimate.bearing_rad == pytest.approx(np.arctan2(*offset[:2]) % (2 * np.pi), abs=0.03)
    assert estimate.extent.width_m == pytest.approx(115.0, abs=25.0)  # 100 m, and a side seen at an angle
    assert estimate.extent.height_m == pytest.approx(100.0, abs=20.0)
    assert estimate.region95.semi_major_m - estimate.ellipse95.semi_major_m == pytest.approx(
        estimate.extent.width_m / 2
    )
    assert (estimate.observations, estimate.baseline_m) == (81, 800.0)
    assert np.linalg.eigvalsh(estimate.covariance_enu_m2).min() > 0


def test_dismissal_is_told_once_and_the_next_target_has_a_new_id() -> None:
    located = localizer()
    flown(located, 200.0)
    states = [located.step(pose_at(210.0 + 10.0 * i), mask_elsewhere())[0].state for i in range(5)]
    assert states[-1] is TargetState.DISMISSED
    assert TargetState.DISMISSED not in states[:-1]
    assert located.step(pose_at(260.0), empty_mask()) == []
    assert located.particles_enu_m(1) is None
    (fresh,) = located.step(pose_at(270.0), cube_mask(pose_at(270.0)))
    assert (fresh.id, fresh.state, fresh.observations) == (2, TargetState.TENTATIVE, 1)
    assert located.particles_enu_m(2) is not None


def test_nothing_seen_gives_nothing() -> None:
    assert localizer().step(pose_at(0.0), empty_mask()) == []


def test_steps_only_after_the_step_distance() -> None:
    located = localizer()
    (first,) = located.step(pose_at(0.0), cube_mask(pose_at(0.0)))
    (second,) = located.step(pose_at(9.9), cube_mask(pose_at(9.9)))
    (third,) = located.step(pose_at(10.0), cube_mask(pose_at(10.0)))
    assert second is first
    assert third.observations == 2
    each = localizer(config=LocalizerConfig(filter="bootstrap", n_particles=1000, step_distance_m=0.0))
    assert [each.step(pose_at(0.0), cube_mask(pose_at(0.0)))[0].observations for _ in range(3)] == [1, 2, 3]


def test_detections_locate_as_the_mask_does() -> None:
    located = localizer()
    for east_m in np.arange(0.0, 601.0, 10.0):
        pose = pose_at(east_m)
        (estimate,) = located.step_detections(pose, detections_from_mask(cube_mask(pose), CAMERA))
    assert np.linalg.norm(estimate.position_enu_m - CUBE_ENU_M) < 200.0
    assert localizer().step_detections(pose_at(0.0), []) == []


def test_same_seed_same_answer() -> None:
    one, same, other = (flown(localizer(seed), 50.0)[-1] for seed in (3, 3, 4))
    assert one.position_enu_m.tolist() == same.position_enu_m.tolist()
    assert one.position_enu_m.tolist() != other.position_enu_m.tolist()


@pytest.mark.parametrize("mask", [np.zeros((1080, 1919), np.uint8), np.zeros((1080, 1920), np.float32)])
def test_wrong_mask_raises(mask: np.ndarray) -> None:
    with pytest.raises(ValueError, match="mask must be"):
        localizer().step(pose_at(0.0), mask)


def test_pose_that_is_not_finite_raises() -> None:
    with pytest.raises(ValueError, match="finite"):
        localizer().step(pose_at(np.nan), empty_mask())


@pytest.mark.parametrize("changes", [{"filter": "other"}, {"dismissal_misses": 0}, {"step_distance_m": -1.0}])
def test_impossible_settings_raise(changes: dict) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        LocalizerConfig(**changes)
