"""Where a film lies in a flight: found where the turning tells it, never claimed where it does not."""

import numpy as np
import pytest

from distloc.calibration.clock_search import ClockSearch, chained, rates_on_grid, search_clock
from distloc.calibration.pose_trail import PoseTrail
from distloc.calibration.time_offset import TimeOffset, estimate_time_offset, turn_residuals, vee
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler, matrix_from_rotation_vector
from distloc.simulation.paths import Wobble
from distloc.types import CameraPose, FloatArray

SPAN_S, HZ = 0.5, 50.0
MOUNT = matrix_from_euler(np.radians(-75.0), np.radians(-5.0), 0.0)


def trail_of(angles_rad: FloatArray, t_s: FloatArray) -> PoseTrail:
    poses = [R_cam_from_enu(matrix_from_euler(*one), MOUNT) for one in angles_rad]
    return PoseTrail([CameraPose(float(t), np.zeros(3), R) for t, R in zip(t_s, poses, strict=True)])


def flown(rng: np.random.Generator, seed: int, log_s: float) -> tuple[FloatArray, FloatArray]:
    """A craft that rocks by up to 3 deg and turns now and then."""
    t_s = np.arange(0.0, log_s, 1.0 / HZ)
    wobble = Wobble(np.radians(3.0), seed)
    angles_rad = np.stack([wobble.at(t) for t in t_s])
    for _ in range(int(log_s / 20.0)):
        angles_rad[:, 0] += rng.normal(0.0, 0.7) / (1.0 + np.exp(-(t_s - rng.uniform(0.0, log_s))))
    return t_s, angles_rad


def searched(seed: int, is_of_flight: bool) -> tuple[ClockSearch | None, TimeOffset | None, float]:
    """A film of 30 s at 10 frames/s in a log of 200 s, and its true offset; or a film of another flight."""
    rng = np.random.default_rng(seed)
    t_s, angles_rad = flown(rng, seed + 1000, 200.0)
    told = trail_of(angles_rad + rng.normal(0.0, np.radians(0.02), angles_rad.shape), t_s)
    seen = trail_of(angles_rad if is_of_flight else flown(rng, seed + 5000, 200.0)[1], t_s)
    offset_s = float(rng.uniform(1.0, 169.0))
    frames_s = np.arange(0.0, 30.0, 0.1)
    R = seen.at(frames_s + offset_s)[0]
    noise = rng.normal(0.0, np.radians(0.02), (len(frames_s) - 1, 3))
    turns = np.stack([matrix_from_rotation_vector(n) @ b @ a.T for n, a, b in zip(noise, R[:-1], R[1:], strict=True)])
    starts_s, ends_s, turns = chained(frames_s[:-1], frames_s[1:], turns, SPAN_S)
    pose_s = t_s[: -int(SPAN_S * HZ) - 1 : 5]
    posed = vee(told.at(pose_s + SPAN_S)[0] @ np.swapaxes(told.at(pose_s)[0], 1, 2))
    found = search_clock(
        rates_on_grid(starts_s, ends_s, vee(turns), 1.0), rates_on_grid(pose_s, pose_s + SPAN_S, posed, 0.3)
    )
    if found is None or not found.is_clear:
        return found, None, offset_s
    moved = (starts_s + found.offset_s, ends_s + found.offset_s)
    return found, estimate_time_offset(turn_residuals(told, *moved, vee(turns)), moved[1]), offset_s


def test_the_place_in_the_log_to_milliseconds_with_an_honest_sigma() -> None:
    scores = []
    for seed in range(12):
        found, fine, offset_s = searched(seed, True)
        if found is None or fine is None or fine.offset_s is None:
            continue
        scores.append((found.offset_s - fine.offset_s - offset_s) / fine.sigma_s)
        assert fine.sigma_s < 0.02
    assert len(scores) >= 9  # of 12
    assert 0.3 < np.sqrt(np.mean(np.square(scores))) < 1.6


def test_a_film_of_another_flight_is_never_tied() -> None:
    for seed in range(100, 112):
        found, fine, _ = searched(seed, False)
        assert fine is None and found is not None and not found.is_clear


def test_turns_are_chained_over_whole_spans_and_never_over_a_gap() -> None:
    times_s = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 2.0, 2.1, 2.2])
    starts_s, ends_s = np.delete(times_s[:-1], 5), np.delete(times_s[1:], 5)  # none from 0.5 to 2.0
    turn = matrix_from_euler(0.01, 0.0, 0.0)
    a, b, turns = chained(starts_s, ends_s, np.stack([turn] * len(starts_s)), 0.3)
    assert a.tolist() == pytest.approx([0.0, 0.2]) and b.tolist() == pytest.approx([0.3, 0.5])
    assert turns[0] == pytest.approx(matrix_from_euler(0.03, 0.0, 0.0))
    assert chained(starts_s, ends_s, np.stack([turn] * len(starts_s)), 5.0)[2].shape == (0, 3, 3)


def test_too_short_a_film_is_not_searched() -> None:
    rates = (0.0, np.ones((20, 3)), np.ones(20, dtype=bool))
    assert search_clock(rates, (0.0, np.ones((4000, 3)), np.ones(4000, dtype=bool))) is None
