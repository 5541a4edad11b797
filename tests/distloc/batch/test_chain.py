"""Whitened residuals have the squares that the whole covariance, inverted at once, gives."""

import math

import numpy as np
import pytest

from distloc.batch.chain import Chain, noise_of
from distloc.batch.lines import frame_of, lines_of
from distloc.types import FloatArray, PoseErrors
from tests.support.sightings import FRAME, seen

ERRORS = PoseErrors(math.radians(2.0), math.radians(0.5), math.radians(0.1), 1.0, 30.0, math.radians(60.0))
PLACE = np.array([300.0, 200.0, 10.0])


def cameras() -> list[FloatArray]:
    return [np.array([100.0 * i, -2000.0 + 150.0 * i * i, 120.0]) for i in range(6)]


def test_squares_are_those_of_the_dense_covariance() -> None:
    sightings = [
        seen(camera, PLACE, np.zeros(3), platform="ab"[i % 2], stamp_s=7.0 * i) for i, camera in enumerate(cameras())
    ]
    lines = lines_of(sightings, [one.platform for one in sightings], frame_of(sightings), ERRORS)
    noise = noise_of(lines, math.radians(0.4), math.radians(0.2), np.full(6, 1500.0))
    n = len(lines)
    dense = np.zeros((n, 2, n, 2))
    for i in range(n):
        dense[i, :, i, :] += noise[i]
        for j in range(n):
            if lines.platform[i] == lines.platform[j]:
                kept = float(np.prod(lines.kept[min(i, j) + 1 : max(i, j) + 1]))
                dense[i, :, j, :] += kept * (lines.to_bias[i] * lines.bias_variance[i]) @ lines.to_bias[j].T
    whole = dense.reshape(2 * n, 2 * n)
    residuals = np.random.default_rng(1).standard_normal((n, 2, 3))
    expected = np.einsum("ik,ij,jk->k", residuals.reshape(-1, 3), np.linalg.inv(whole), residuals.reshape(-1, 3))
    chain = Chain(lines, noise)
    assert np.square(chain.whitened(residuals)).sum(axis=(0, 1)) == pytest.approx(expected)
    assert chain.log_determinant == pytest.approx(float(np.linalg.slogdet(whole)[1]))


def test_a_turn_of_the_attitude_moves_a_residual_as_told() -> None:
    camera = np.array([0.0, -3000.0, 200.0])
    for turn in np.eye(3) * 1e-4:
        sightings = [seen(camera, PLACE, turn)]
        frame = frame_of(sightings)
        lines = lines_of(sightings, [""], frame, ERRORS)
        there, shift = frame.from_other(FRAME)
        residual = lines.residuals((there @ PLACE + shift)[None])[0, :, 0]
        assert residual == pytest.approx(lines.to_bias[0] @ turn, abs=2e-8)


def test_what_is_left_out_passes_its_time_on() -> None:
    sightings = [seen(camera, PLACE, np.zeros(3), stamp_s=7.0 * i) for i, camera in enumerate(cameras())]
    lines = lines_of(sightings, [""] * 6, frame_of(sightings), ERRORS)
    some = lines.of(np.array([False, True, False, False, True, True]))
    assert some.kept == pytest.approx([0.0, float(np.prod(lines.kept[2:5])), lines.kept[5]])
