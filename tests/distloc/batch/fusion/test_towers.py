"""Towers' bearings: honest with mounts that are wrong by degrees, and of no fire where that is not sure."""

import numpy as np
import pytest

from distloc.batch.fusion.claims import Bearing, FusedFire
from distloc.batch.fusion.towers import tightened


def fire(number: int, at: tuple[float, float], sigma_m: float = 40.0) -> FusedFire:
    return FusedFire((f"d/{number}",), np.array(at), sigma_m**2 * np.eye(2))


def bearing(azimuth_deg: float, tower: str = "t", at: tuple[float, float] = (0.0, -8_000.0)) -> Bearing:
    return Bearing(
        f"{tower}@{azimuth_deg}", tower, np.array(at), np.radians(azimuth_deg), np.radians(0.3), np.radians(3.0)
    )


def test_two_hundred_sets_of_towers_with_wrong_mounts_are_honest() -> None:
    """One to three fires, two towers off by 3 degrees: the ellipses hold, the mounts' errors are found as told."""
    rng = np.random.default_rng(11)
    inside, mounts, ratios = [], [], []
    for _ in range(200):
        truths = rng.uniform(-3_000.0, 3_000.0, (int(rng.integers(1, 4)), 2))
        P = [np.diag(rng.uniform(15.0, 80.0, 2) ** 2) for _ in truths]
        fires = [
            FusedFire((f"d/{i}",), truth + rng.multivariate_normal([0.0, 0.0], P[i]), P[i])
            for i, truth in enumerate(truths)
        ]
        bearings, off = [], {}
        for name, turn in zip("ab", rng.uniform(0.0, 2.0 * np.pi, 2), strict=True):
            place = 8_000.0 * np.array([np.sin(turn), np.cos(turn)])
            off[name] = rng.normal() * np.radians(3.0)
            for i, truth in enumerate(truths):
                azimuth = np.arctan2(*(truth - place)) + off[name] + rng.normal() * np.radians(0.3)
                bearings.append(Bearing(f"{name}@{i}", name, place, float(azimuth), np.radians(0.3), np.radians(3.0)))
        found, biases = tightened(fires, bearings)
        for i, one in enumerate(found):
            if one.bearings:
                assert all(name.endswith(f"@{i}") for name in one.bearings)
                away = one.position_en_m - truths[i]
                inside.append(away @ np.linalg.solve(one.covariance_m2, away) < 5.991)
                ratios.append(np.sqrt(np.linalg.det(one.covariance_m2) / np.linalg.det(P[i])))
        mounts += [(one.bias_rad - off[one.tower]) / one.sigma_rad for one in biases]
    assert len(inside) > 300
    assert 0.92 < np.mean(inside) < 0.98
    assert 0.85 < np.std(mounts) < 1.15
    assert np.median(ratios) < 0.85


def test_a_bearing_between_two_fires_is_of_neither_and_one_far_off_of_none() -> None:
    fires = [fire(1, (-150.0, 0.0)), fire(2, (150.0, 0.0))]
    found, biases = tightened(fires, [bearing(0.0)])
    assert [one.bearings for one in found] == [(), ()] and biases == ()
    assert tightened([fire(1, (0.0, 0.0))], [bearing(30.0)])[1] == ()
    assert tightened([], [bearing(0.0)]) == ([], ())


@pytest.mark.parametrize("off_m", [300.0, 600.0, 800.0, 1_000.0, 1_200.0, -700.0])
def test_a_bearing_of_another_smoke_does_not_take_the_fire_along(off_m: float) -> None:
    """The fire is at 0 with its long axis north; a tower in the east, with a good mount, sees smoke beside it."""
    one = FusedFire(("d/1",), np.zeros(2), np.diag([30.0**2, 300.0**2]))
    tower = np.array([10_000.0, 0.0])
    azimuth = float(np.arctan2(-10_000.0, off_m))
    seen = Bearing("t@1", "t", tower, azimuth, np.radians(0.3), np.radians(0.5))
    ((found,), _) = tightened([one], [seen])
    assert found.position_en_m @ np.linalg.solve(found.covariance_m2, found.position_en_m) < 5.991
    if abs(off_m) >= 600.0:
        assert found.bearings == () and np.array_equal(found.covariance_m2, one.covariance_m2)


def test_with_one_bearing_in_five_of_another_smoke_the_ellipses_hold() -> None:
    """400 fires, long along a drone's line of sight, and two towers off by 3 degrees."""
    rng = np.random.default_rng(42)
    inside, wrong = [], 0
    for _ in range(400):
        P = np.diag([rng.uniform(60.0, 400.0) ** 2, rng.uniform(15.0, 60.0) ** 2])
        one = FusedFire(("d/1",), rng.multivariate_normal(np.zeros(2), P), P)
        bearings = []
        for name, turn in zip("ab", rng.uniform(0.0, 2.0 * np.pi, 2), strict=True):
            place = 8_000.0 * np.array([np.sin(turn), np.cos(turn)])
            is_other = rng.random() < 0.2
            aside = rng.uniform(-1.0, 1.0) * np.radians(15.0) if is_other else 0.0
            error = rng.normal() * np.radians(3.0) + rng.normal() * np.radians(0.3)
            azimuth = float(np.arctan2(*-place) + aside + error)
            kind = "other" if is_other else "own"
            bearings.append(Bearing(f"{name}@{kind}", name, place, azimuth, np.radians(0.3), np.radians(3.0)))
        ((found,), _) = tightened([one], bearings)
        if found.bearings:
            inside.append(found.position_en_m @ np.linalg.solve(found.covariance_m2, found.position_en_m) < 5.991)
            wrong += any(bearing.endswith("@other") for bearing in found.bearings)
    assert len(inside) > 250 and wrong > 10
    assert 0.92 < np.mean(inside) < 0.98


def test_a_mount_that_one_fire_told_of_makes_another_surer() -> None:
    fires = [fire(1, (0.0, 0.0), 5.0), fire(2, (2_000.0, 0.0), 150.0)]
    off = 2.0
    second = np.degrees(np.arctan2(2_000.0, 8_000.0))
    found, (bias,) = tightened(fires, [bearing(off), bearing(second + off)])
    assert np.degrees(bias.bias_rad) == pytest.approx(off, abs=0.3) and bias.fires == 2
    assert np.linalg.det(found[1].covariance_m2) < 0.4**2 * np.linalg.det(fires[1].covariance_m2)
