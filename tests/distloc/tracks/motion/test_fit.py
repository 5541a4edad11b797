"""Bearings of a thing that stands, creeps or is driven: where the fit says it is, and which prior explains them."""

import numpy as np
import pytest

from distloc.tracks.motion.bearings import MOST, TIME, Bearings
from distloc.tracks.motion.fit import Appearance, Fit, fitted
from distloc.types import FloatArray

AIM_RAD = np.array([0.002])
HEADING_RAD, TAU_S = float(np.radians(2.0)), 120.0


def seen(
    places_m: FloatArray, velocity_mps: tuple[float, float], seconds: FloatArray, error_rad: float = 0.0
) -> Bearings:
    """By cameras at (n, 2), of a thing that is 1500 m north of the origin at 0 s."""
    bearings = Bearings()
    rows = np.zeros((seconds.size, 8))
    target_m = np.array([0.0, 1500.0]) + seconds[:, None] * np.array(velocity_mps)
    line_m = target_m - places_m
    rows[:, 0], rows[:, 1:3], rows[:, 4], rows[:, 5] = seconds, places_m, 0.002, HEADING_RAD
    rows[:, 3], rows[:, 6] = np.arctan2(line_m[:, 0], line_m[:, 1]) + error_rad, seconds / TAU_S
    bearings.held[:] = rows[np.linspace(0, seconds.size - 1, MOST).astype(int)]
    bearings.count = MOST
    return bearings


def straight(velocity_mps: tuple[float, float]) -> Bearings:
    seconds = np.arange(150.0)
    return seen(np.stack([10.0 * seconds - 750.0, np.zeros(150)], axis=1), velocity_mps, seconds)


def orbit(velocity_mps: tuple[float, float], duration_s: float = 900.0) -> Bearings:
    seconds = np.arange(0.0, duration_s, 5.0)
    angle = seconds * 10.0 / 1500.0
    places_m = np.array([0.0, 1500.0]) + 1500.0 * np.stack([-np.sin(angle), -np.cos(angle)], axis=1)
    return seen(places_m, velocity_mps, seconds)


def looking(height_rad: float, lean: tuple[float, float] = (0.0, 0.0), pictures: float = 0.0, k: int = 1) -> Appearance:
    information = np.repeat(pictures * np.eye(2)[None], k, axis=0)
    return Appearance(np.full(k, height_rad), information, np.repeat(pictures * np.array([lean]), k, axis=0))


NOBODY_KNOWS = looking(0.0)


def fit_of(bearings: Bearings, appearance: Appearance = NOBODY_KNOWS) -> Fit:
    return fitted([bearings], np.array([[50.0, 1300.0]]), AIM_RAD, appearance)


def squared(fit: Fit, index: int, truth_m: FloatArray) -> float:
    off_m = fit.place_m[0, index] - truth_m
    return float(off_m @ np.linalg.solve(fit.place_m2[0, index], off_m))


def test_what_stands_is_found_and_explained_by_standing() -> None:
    fit = fit_of(orbit((0.0, 0.0)))
    assert squared(fit, 0, np.array([0.0, 1500.0])) < 1.0
    assert fit.log_evidence[0].argmax() == 0


def test_on_one_course_what_drives_cannot_be_told_and_its_place_is_wide_enough() -> None:
    fit = fit_of(straight((5.0, 0.0)))
    truth_m = np.array([5.0 * 149.0, 1500.0])
    assert abs(fit.log_evidence[0, 2] - fit.log_evidence[0, 0]) < 1.5
    assert squared(fit, 2, truth_m) < 6.0 < squared(fit, 0, truth_m)


@pytest.mark.parametrize("speed_mps", [0.5, 1.0])
def test_a_front_that_creeps_is_followed(speed_mps: float) -> None:
    bearings = orbit((speed_mps, 0.0))
    fit = fit_of(bearings)
    truth_m = np.array([speed_mps * bearings.held[-1, 0], 1500.0])
    assert fit.log_evidence[0].argmax() == 1
    assert fit.velocity_mps[0, 1] == pytest.approx([speed_mps, 0.0], abs=0.15)
    assert squared(fit, 1, truth_m) < 6.0 < squared(fit, 0, truth_m)


def test_two_courses_tell_what_drives() -> None:
    seconds = np.arange(240.0)
    east_m = np.where(seconds < 120.0, 10.0 * seconds, 1200.0)
    north_m = np.where(seconds < 120.0, 0.0, 8.0 * (seconds - 120.0))
    fit = fit_of(seen(np.stack([east_m, north_m], axis=1), (-6.0, 0.0), seconds))
    assert fit.log_evidence[0, 2] > fit.log_evidence[0, 0] + 5.0
    assert squared(fit, 2, np.array([-6.0 * 239.0, 1500.0])) < 6.0


def test_dust_is_low_where_it_would_be_if_it_drives() -> None:
    # 45 m high at 1500 m, the craft's own way at half its speed: if it stands it is at twice that, and as high as smoke
    bearings = straight((5.0, 0.0))
    driven = [
        fit_of(bearings, looking(height_m / 1500.0)).log_evidence[0, :3] @ (-1, 0, 1) for height_m in (30.0, 45.0)
    ]
    standing = [
        fit_of(straight((0.0, 0.0)), looking(height_m / 1500.0)).log_evidence[0, :3] @ (-1, 0, 1)
        for height_m in (150.0, 250.0)
    ]
    assert driven[0] > driven[1] > -2.5
    assert -3.0 > standing[0] > standing[1]


def test_dust_is_drawn_out_behind_what_raises_it() -> None:
    bearings, ratios = straight((5.0, 0.0)), []
    for lean in (-1.2, 0.0, 1.2):
        evidence = fit_of(bearings, looking(45.0 / 1500.0, (lean, 0.0), 20.0)).log_evidence[0]
        ratios.append(evidence[2] - evidence[0])
        assert evidence[1] == pytest.approx(evidence[0], abs=0.2)  # a front says nothing of it
    assert ratios[0] > ratios[1] + 1.0 and ratios[1] > ratios[2]


def test_pictures_from_one_side_tell_how_it_leans_across_and_nothing_along() -> None:
    across, information = np.array([[20.0, 0.0]]), np.diag([20.0, 0.0])[None]
    blind = fit_of(straight((5.0, 0.0)), looking(0.03)).log_evidence[0]
    upright = fit_of(straight((5.0, 0.0)), Appearance(np.array([0.03]), information, 0.0 * across)).log_evidence[0]
    behind = fit_of(straight((5.0, 0.0)), Appearance(np.array([0.03]), information, -across)).log_evidence[0]
    assert upright[2] - upright[0] < blind[2] - blind[0] - 0.1 < behind[2] - behind[0]
    assert np.isfinite(behind).all()


def test_targets_are_fitted_apart_and_few_bearings_do() -> None:
    few = orbit((0.0, 0.0))
    few.count = 6
    one, both = (
        fit_of(few),
        fitted([few, orbit((1.0, 0.0))], np.array([[50.0, 1300.0]] * 2), np.repeat(AIM_RAD, 2), looking(0.0, k=2)),
    )
    assert both.log_evidence[0] == pytest.approx(one.log_evidence[0])
    assert both.place_m[0] == pytest.approx(one.place_m[0])
    assert np.isfinite(both.place_m2).all()


@pytest.mark.parametrize("later_s", [-0.02, -100.0, -1.7e9, 1.7e9])
def test_a_clock_that_is_set_leaves_what_stands_where_it_is(later_s: float) -> None:
    rows = orbit((0.0, 0.0)).rows
    rows[MOST // 2 :, TIME] += later_s
    fit = fit_of(Bearings(rows))
    assert all(np.isfinite(one).all() for one in (fit.log_evidence, fit.place_m, fit.velocity_mps, fit.place_m2))
    assert squared(fit, 0, np.array([0.0, 1500.0])) < 1.0
