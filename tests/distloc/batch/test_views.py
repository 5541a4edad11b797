"""Sightings in company say what the whole covariance of all of them, inverted at once, says."""

import math
from dataclasses import replace

import numpy as np
import pytest

from distloc.batch.lines import frame_of, lines_of
from distloc.batch.views import Company, Seen
from distloc.types import PoseErrors
from tests.support.sightings import FRAME, seen

ERRORS = PoseErrors(math.radians(2.0), math.radians(0.5), math.radians(0.1), 1.0, 60.0, math.radians(90.0))
PLACE, OTHER = np.array([300.0, 200.0, 10.0]), np.array([-400.0, 500.0, 30.0])
JUMP, SCATTER = math.radians(0.4), math.radians(0.2)


def test_squares_are_those_of_the_dense_covariance() -> None:
    sightings = [
        seen(np.array([200.0 * i, -2000.0, 120.0]), point, np.zeros(3), stamp_s=7.0 * i, target=name)
        for i in range(4)
        for name, point in (("a", PLACE), ("b", OTHER))
    ]
    frame = frame_of(sightings)
    sightings = [replace(one, sigma_rad=(1e-3, 2e-3), heading_rad=0.3) for one in sightings]
    lines = lines_of(sightings, [""] * 8, frame, ERRORS)
    R_frame_from_map, shift_m = frame.from_other(FRAME)
    place, other = R_frame_from_map @ PLACE + shift_m, R_frame_from_map @ OTHER + shift_m
    which = np.array([-1 if sightings[i].target == "a" else 0 for i in lines.index.tolist()])
    company = Company(lines, which, other[None], np.array([1e-3]))
    views = Seen(lines.of(which < 0), company, place).views((JUMP, SCATTER))

    n = len(lines)
    at = np.where((which < 0)[:, None], place, other)
    range_m = np.linalg.norm(at - lines.position_enu_m, axis=1)
    by_shift = lines.basis / range_m[:, None, None]
    up = lines.up[0]
    dense = np.zeros((n, 2, n, 2))
    for i in range(n):
        dense[i, :, i, :] += np.diag(lines.mark[i] ** 2 + SCATTER**2 + 1e-9)
        for j in range(n):
            kept = float(np.prod(lines.kept[min(i, j) + 1 : max(i, j) + 1]))
            dense[i, :, j, :] += kept * (lines.to_bias[i] * lines.bias_variance[i]) @ lines.to_bias[j].T
            if lines.picture[i] == lines.picture[j]:
                turn = np.eye(3) * ERRORS.attitude_white_rad**2 + JUMP**2 * np.outer(up, up)
                dense[i, :, j, :] += lines.to_bias[i] @ turn @ lines.to_bias[j].T + by_shift[i] @ by_shift[j].T
            if which[i] == which[j] == 0:
                dense[i, :, j, :] += 1e-6 * np.eye(2)
                dense[i, :, j, :] += float(range_m[which == 0].mean()) ** 2 * by_shift[i] @ by_shift[j].T
    whole = dense.reshape(2 * n, 2 * n)
    tried = place + np.array([[0.0, 0.0, 0.0], [40.0, -20.0, 5.0]])
    residuals = np.repeat(lines.residuals_each(at), 2, axis=2)
    residuals[which < 0] = lines.of(which < 0).residuals(tried)
    expected = np.einsum("ik,ij,jk->k", residuals.reshape(-1, 2), np.linalg.inv(whole), residuals.reshape(-1, 2))
    assert np.square(views.white(tried)).sum(axis=0) == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert views.log_determinant == pytest.approx(float(np.linalg.slogdet(whole)[1]))
