"""Platforms' biases are found by other fires, as exactly as these tell them, and never by the fire that is scored."""

import math

import numpy as np
import pytest

from distloc.study.ignitions.biases import biases_for
from distloc.study.ignitions.known import Look

DAY_S, TOLD_RAD = 86_400.0, math.radians(3.0)


def looks(rng: np.random.Generator, platforms: int, fires: int, bias_deg: float, own_deg: float) -> list[Look]:
    true_deg = bias_deg * rng.standard_normal(platforms)
    return [
        Look(str(p), str(f), math.radians(true_deg[p] + own_deg * rng.standard_normal()), 15e3, 0.0, f * DAY_S)
        for p in range(platforms)
        for f in range(fires)
    ]


def test_what_is_told_holds_what_the_next_look_shows() -> None:
    """The bias and its sigma, by the fires but one, against that one's look: by many networks."""
    beyond, sigmas, squares = [], [], []
    for seed in range(12):
        rng = np.random.default_rng([41, seed])
        all_looks = looks(rng, 8, 6, 2.5, 0.8)
        for fire in ("1", "5"):
            others = [one for one in all_looks if one.fire != fire]
            found = biases_for([str(p) for p in range(8)], int(fire) * DAY_S, others, TOLD_RAD)
            for one in (look for look in all_looks if look.fire == fire):
                bias = found[one.platform]
                z = (one.beside_rad - bias.mean_rad) / bias.sigma_rad
                beyond.append(abs(z) > 1.96)
                squares.append(z * z)
                sigmas.append(math.degrees(bias.sigma_rad))
    assert 0.01 < float(np.mean(beyond)) < 0.1
    assert 0.7 < float(np.mean(squares)) < 1.3
    assert 0.8 < float(np.median(sigmas)) < 1.3  # 2.5 degrees before, 0.8 * sqrt(1 + 1/5) by five fires


def test_who_was_never_seen_to_err_has_the_others_size() -> None:
    rng = np.random.default_rng(3)
    found = biases_for(["new"], 0.0, looks(rng, 12, 5, 1.0, 0.3), TOLD_RAD)["new"]
    assert found.fires == 0 and found.mean_rad == 0.0
    assert 0.6 < math.degrees(found.sigma_rad) < 1.8


def test_without_any_other_fire_it_is_what_was_told() -> None:
    found = biases_for(["a"], 0.0, [], TOLD_RAD)["a"]
    assert found.mean_rad == 0.0 and 2.0 < math.degrees(found.sigma_rad) < 6.0


def test_a_look_at_something_else_is_left_out() -> None:
    rng = np.random.default_rng(5)
    all_looks = looks(rng, 6, 6, 1.0, 0.3)
    clean = biases_for(["0"], 0.0, all_looks, TOLD_RAD)["0"]
    bird = Look("0", "bird", math.radians(35.0), 15e3, 0.0, 3 * DAY_S)
    found = biases_for(["0"], 0.0, [*all_looks, bird], TOLD_RAD)["0"]
    assert found.fires == clean.fires
    assert found.mean_rad == pytest.approx(clean.mean_rad, abs=math.radians(0.1))


def test_a_camera_that_was_turned_is_believed_by_its_last_looks() -> None:
    """A year of one bias, then weeks of another: what is old tells less."""
    rng = np.random.default_rng(9)
    old = [
        Look(str(p), f"old{f}", math.radians(3.0 * (-1) ** p), 15e3, 0.0, f * DAY_S) for p in range(6) for f in range(4)
    ]
    new = [
        Look(
            str(p),
            f"new{f}",
            math.radians(-3.0 * (-1) ** p + 0.2 * rng.standard_normal()),
            15e3,
            0.0,
            (400 + f) * DAY_S,
        )
        for p in range(6)
        for f in range(4)
    ]
    found = biases_for(["0"], 404 * DAY_S, [*old, *new], TOLD_RAD)["0"]
    assert math.degrees(found.mean_rad) == pytest.approx(-3.0, abs=1.0)
