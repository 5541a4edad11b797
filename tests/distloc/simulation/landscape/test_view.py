"""A rolling shutter's rows: where points are seen, and how a picture shears."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.landscape.renderer import LandscapeRenderer
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.sensor import CameraFaults
from distloc.simulation.landscape.things import MAST, Uprights
from distloc.simulation.landscape.view import View
from distloc.simulation.plume import Plume
from distloc.types import CameraPose
from tests.distloc.simulation.landscape.truth import CAMERA, seen

RATE_RPS, READOUT_S = np.radians(20.0), 0.03
LEVEL = replace(SCENES["flat"], noise=0.0)


def turning(stamp_s: float) -> CameraPose:
    """A camera that flies east and turns to the right."""
    R = R_cam_from_enu(matrix_from_euler(RATE_RPS * (stamp_s - 10.0), np.radians(-8.0), 0.05), np.eye(3))
    return CameraPose(stamp_s, np.array([28.0 * (stamp_s - 10.0), 0.0, 120.0]), R)


def row_stamp_s(row: float) -> float:
    """When a row is read: the middle of the picture at the frame's stamp."""
    return 10.0 + READOUT_S * ((row + 0.5) / CAMERA.height - 0.5)


def test_a_point_is_seen_by_the_pose_of_its_own_row() -> None:
    rng = np.random.default_rng(1)
    points = np.stack([rng.uniform(-250, 250, 40), rng.uniform(300, 600, 40), rng.uniform(0, 60, 40)])
    view = View(CAMERA, turning(10.0), turning, READOUT_S)
    for point, pixel in zip(points.T, view.project(points).T, strict=True):
        there = seen(turning(row_stamp_s(pixel[1])), point[:, None])[:, 0]
        assert there == pytest.approx(pixel, abs=0.01)


def test_without_a_readout_all_rows_share_the_pose() -> None:
    points = np.array([[10.0, -40.0], [400.0, 600.0], [0.0, 30.0]])
    view = View(CAMERA, turning(10.0), turning, 0.0)
    assert view.project(points) == pytest.approx(seen(turning(10.0), points))
    assert not view.is_rolling


def mast(readout_s: float, colour: float) -> LandscapeRenderer:
    drawn = LandscapeRenderer(CAMERA, [], np.random.default_rng(3), LEVEL, CameraFaults(readout_s))
    base, one = np.array([[10.0], [150.0], [0.0]]), np.ones(1)
    drawn.uprights = Uprights(base, 110.0 * one, 0.8 * one, np.full(1, MAST), 0.0 * one, np.full((3, 1), colour))
    return drawn


def test_a_mast_leans_by_what_the_camera_turns_while_its_rows_are_read() -> None:
    lines = []
    for readout_s in (0.0, READOUT_S):
        bright, dark = (mast(readout_s, c).render(turning(10.0), turning)[0].astype(float) for c in (240.0, 1.0))
        cover = (bright - dark).mean(axis=2)
        rows = np.flatnonzero(cover.max(axis=1) > 60.0)
        lines.append((rows, (cover[rows] * np.arange(640.0)).sum(axis=1) / cover[rows].sum(axis=1)))
    rows = np.intersect1d(lines[0][0], lines[1][0])
    lean = [np.interp(rows, *line) for line in lines]
    leant = np.polyfit(rows, lean[1] - lean[0], 1)[0]
    across = 450.0 * (1.0 + (lean[0].mean() - 320.0) ** 2 / 450.0**2) * RATE_RPS * READOUT_S / CAMERA.height
    assert leant == pytest.approx(-(across + 450.0 * 28.0 / 150.0 * READOUT_S / CAMERA.height), rel=0.08)


def test_the_ground_and_the_smoke_shear_with_the_rows() -> None:
    plume = Plume(np.array([0.0, 900.0, 0.0]), 160.0, 120.0, np.zeros(3))
    drawn = LandscapeRenderer(CAMERA, [plume], np.random.default_rng(3), LEVEL, CameraFaults(READOUT_S))
    (image, mask), (still, its_mask) = drawn.render(turning(10.0), turning), drawn.render(turning(10.0))
    for row in (170, 230, 300):  # each row is that of a still camera at its moment, but for the rows beside it
        alone, alone_mask = drawn.render(replace(turning(row_stamp_s(row)), stamp_s=10.0))
        assert (
            np.abs(image[row].astype(int) - alone[row]).mean()
            < 0.35 * np.abs(still[row].astype(int) - alone[row]).mean()
        )
        assert np.count_nonzero(mask[row] != alone_mask[row]) <= 6
    assert np.count_nonzero(mask != its_mask) > 20


def test_an_exposure_smears_along_the_motion_and_shifts_nothing() -> None:
    sharp, smeared = (
        LandscapeRenderer(CAMERA, [], np.random.default_rng(3), replace(SCENES["hills"], noise=0.0), faults)
        .render(turning(10.0), turning)[0][200:]
        .astype(np.float64)
        .mean(axis=2)
        for faults in (CameraFaults(), CameraFaults(exposure_s=0.06))  # 10 px
    )
    steps = [[np.abs(np.diff(one, axis=axis)).mean() for axis in (0, 1)] for one in (sharp, smeared)]
    assert steps[1][1] < 0.75 * steps[0][1]  # across: along the turn
    assert steps[1][0] / steps[0][0] > steps[1][1] / steps[0][1]
    gradient = np.gradient(smeared, axis=1)
    assert abs((gradient * (sharp - smeared)).sum() / (gradient**2).sum()) < 0.15
