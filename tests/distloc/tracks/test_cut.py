"""Smoke that the image's border cuts: what is seen of it tells its bearing all the same."""

import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas
from distloc.simulation.targets import Box
from distloc.types import CameraPose, FloatArray, TargetEstimate, TargetState
from tests.support.cube_samples import CAMERA, R_NORTH, empty_mask

COLUMNS = [(700.0, 1000.0), (1000.0, 1500.0), (1200.0, 2000.0)]  # height and range in metres


class Driven:
    """Dust that drives east at 7 m/s, right of where the craft begins."""

    def centre_enu_m(self, stamp_s: float) -> FloatArray:
        return np.array([7.0 * stamp_s - 525.0, 1500.0, 10.0])

    def draw(self, mask: NDArray[np.uint8], camera: Camera, pose: CameraPose) -> None:
        Box(self.centre_enu_m(pose.stamp_s), (60.0, 20.0, 20.0)).draw(mask, camera, pose)


def flown(column: Box | Driven, steps: int, seed: int, side: float = 0.0) -> list[list[TargetEstimate]]:
    """Past a column, half its range on each side; the poses are off by what the localizer is told.

    With a `side` the camera follows the column so that this border goes through its middle.
    """

    def on_the_way(stamp_s: float) -> CameraPose:
        place = np.array([10.0 * stamp_s - 5.0 * steps, 0.0, 80.0])
        if side == 0.0:
            return CameraPose(stamp_s, place, R_NORTH)
        off_m = column.centre_enu_m(stamp_s) - place
        azimuth_rad = np.arctan2(off_m[0], off_m[1]) - side * np.arctan(960.0 / CAMERA.fx)
        turn = matrix_from_rotation_vector(np.array([0.0, 0.0, azimuth_rad]))
        return CameraPose(stamp_s, place, R_NORTH @ turn, heading_rad=np.pi / 2.0)

    localizer = Localizer(CAMERA, LocalizerConfig(n_particles=4000), rng=np.random.default_rng(seed))
    errors = CorrelatedPoseErrors(CorrelatedSigmas(tau_s=120.0), np.random.default_rng([seed, 1]))
    estimates = []
    for k in range(steps):
        mask = empty_mask()
        column.draw(mask, CAMERA, on_the_way(float(k)))
        estimates.append(localizer.step(errors.reported(on_the_way, float(k)), mask))
    return estimates


@pytest.mark.parametrize(("height_m", "range_m"), COLUMNS)
def test_a_column_that_is_cut_above_is_told_of_and_its_foot_is_in_the_ellipse(height_m: float, range_m: float) -> None:
    column = Box(np.array([0.0, range_m, height_m / 2.0]), (60.0, 60.0, height_m))
    inside = 0
    for seed in range(3):
        estimates = flown(column, int(range_m / 10.0), seed)
        assert estimates[14], "told of within 10 steps of the fourth sighting"
        (last,) = estimates[-1]
        assert last.state is TargetState.CONFIRMED
        offset_m = (column.centre_enu_m(0.0) - last.position_enu_m)[:2]
        inside += ellipse_holds(last.ellipse95, offset_m)
        assert np.linalg.norm(offset_m) < 0.15 * range_m
    assert inside >= 2


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_fire_whose_root_a_side_cuts_all_along_is_confirmed_and_in_the_ellipse(side: float) -> None:
    column, inside = Box(np.array([0.0, 1500.0, 60.0]), (60.0, 60.0, 120.0)), []
    for seed in range(3):
        estimates = flown(column, 150, seed, side)
        believed = [one for told in estimates for one in told if one.state is TargetState.CONFIRMED]
        assert len(believed) > 60 and len({one.id for one in believed}) == 1
        inside += [
            ellipse_holds(one.ellipse95, (column.centre_enu_m(0.0) - one.position_enu_m)[:2]) for one in believed
        ]
        assert believed[-1].ellipse95.semi_major_m < 0.3 * 1500.0
    assert np.mean(inside) > 0.85


def test_what_drives_and_is_cut_at_a_side_all_along_is_not_confirmed() -> None:
    confirmed = [TargetState.CONFIRMED in [one.state for one in told] for told in flown(Driven(), 150, 0, 1.0)]
    assert np.mean(confirmed) < 0.05
