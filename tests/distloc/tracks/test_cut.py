"""Smoke that the image's border cuts: what is seen of it tells its bearing all the same."""

import numpy as np
import pytest

from distloc.filter.uncertainty import ellipse_holds
from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas
from distloc.simulation.targets import Box
from distloc.types import CameraPose, TargetEstimate, TargetState
from tests.support.cube_samples import CAMERA, R_NORTH, empty_mask

COLUMNS = [(700.0, 1000.0), (1000.0, 1500.0), (1200.0, 2000.0)]  # height and range in metres


def flown(column: Box, steps: int, seed: int) -> list[list[TargetEstimate]]:
    """Past a column, half its range on each side; the poses are off by what the localizer is told."""

    def on_the_way(stamp_s: float) -> CameraPose:
        return CameraPose(stamp_s, np.array([10.0 * stamp_s - 5.0 * steps, 0.0, 80.0]), R_NORTH)

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
