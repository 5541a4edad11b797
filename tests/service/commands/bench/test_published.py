"""The published libraries fly the same filter as ours: the same weights, and they end as near to the truth."""

import importlib.util
import sys

import numpy as np
import pytest

import service.commands.bench.published as published_package
from distloc.study.scenes import PAPER_CAMERA
from service.commands.bench.filters.literal_update import literal_weights
from service.commands.bench.published.compared import ENOUGH_HOLDS, LIBRARIES, SIZES, measure_published
from service.commands.bench.scene import frames

# of the libraries, not ours: what they warn of when they are imported is theirs
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::SyntaxWarning")


@pytest.mark.thorough
def test_all_end_within_the_same_distance_of_the_truth() -> None:
    result = measure_published(20_000)
    ours_m = result.bootstrap_error_m
    assert 0.0 < ours_m < 100.0  # 2 km away, the paper's diffusion of 5 m a step
    measured = {rival.library: rival for rival in result.rivals if rival.step is not None}
    assert set(measured) == {name for name in LIBRARIES if importlib.util.find_spec(name)}
    for rival in measured.values():
        assert rival.error_m == pytest.approx(ours_m, abs=40.0), rival.library
        assert rival.step is not None
        assert rival.step.n == result.calibrated.n == 100


def test_what_is_not_installed_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in {*LIBRARIES, *(one for one in sys.modules if one.partition(".")[0] in LIBRARIES)}:
        monkeypatch.setitem(sys.modules, module, None)  # type: ignore[arg-type]
    for name in LIBRARIES:
        monkeypatch.delitem(sys.modules, f"service.commands.bench.published.with_{name}", raising=False)
        monkeypatch.delattr(published_package, f"with_{name}", raising=False)
    result = measure_published(500, number=3)
    assert [(one.library, one.version, one.step, one.error_m) for one in result.rivals] == [
        (name, None, None, None) for name in LIBRARIES
    ]
    assert result.calibrated.n == 2


def test_the_least_particles_do_that_are_as_near_and_hold_the_truth() -> None:
    result = measure_published(4_096, number=30)
    assert result.enough_particles in SIZES and result.enough.n == 29
    nearest_m = min(
        (one.error_m for one in result.rivals if one.error_m is not None), default=result.calibrated_error_m
    )
    is_good = result.enough_worst_m <= nearest_m and result.enough_holds >= ENOUGH_HOLDS
    assert is_good or result.enough_particles == SIZES[-1]
    assert result.enough_error_m <= result.enough_worst_m


def test_their_weights_are_the_literal_ones_at_whole_pixels() -> None:
    seen = next(frames(1))
    rng = np.random.default_rng(3)
    rows, columns = np.nonzero(seen.mask)
    u = rng.integers(columns.min() - 4, columns.max() + 5, 3000).astype(float)
    v = rng.integers(rows.min() - 4, rows.max() + 5, 3000).astype(float)
    rays = PAPER_CAMERA.rays(np.stack([u, v]))
    behind = np.array([[0.0], [-500.0], [0.0]])
    particles = np.hstack([seen.pose.R_cam_from_enu.T @ rays * 2000.0 + seen.pose.position_enu_m[:, None], behind])
    literal = literal_weights(PAPER_CAMERA, particles, seen.pose, seen.mask)
    weights = np.exp(seen.near.log_weights(particles, seen.pose))
    assert 0.3 < np.mean(literal > 0.5) < 0.98
    assert weights[-1] == literal[-1] == 0.0
    assert np.abs(weights - literal).max() < 0.02  # the chamfer's distances are a few per cent off


def test_far_from_the_mask_nothing_weighs() -> None:
    seen = next(frames(1))
    corners = PAPER_CAMERA.rays(np.array([[0.0, 1919.0, 0.0], [0.0, 1079.0, 1079.0]]))
    particles = seen.pose.R_cam_from_enu.T @ corners * 2000.0 + seen.pose.position_enu_m[:, None]
    assert np.exp(seen.near.log_weights(particles, seen.pose)).tolist() == [0.0, 0.0, 0.0]
