"""Angles that are frozen, late or of an unknown mount are found by a film that was drawn with the true ones."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.rotations import matrix_from_euler, quaternion_from_euler
from distloc.types import FloatArray
from service.config.camera_section import CameraConfig, MountConfig
from service.recordings.importers.clocks.clock_tie import tie_clocks
from service.recordings.importers.clocks.turning_check import turning_of
from service.recordings.importers.film import film_of
from service.recordings.importers.flight import Attitudes, ImportedFlight, unknown

FPS, SECONDS, FX = 10.0, 24.0, 300.0
SIZE = (320, 240)
MOUNT_PITCH_DEG = -10.0


def angles_rad(time_s: FloatArray) -> FloatArray:
    """(N, 3) yaw, pitch, roll of a craft that rocks, never twice alike."""
    yaw = 8.0 * np.sin(0.61 * time_s) + 3.0 * np.sin(1.37 * time_s + 1.0)
    pitch = 3.0 * np.sin(0.93 * time_s + 0.5) + 1.5 * np.sin(1.71 * time_s)
    roll = 5.0 * np.sin(0.73 * time_s + 2.0) + 2.0 * np.sin(1.53 * time_s)
    return np.radians(np.stack([yaw, pitch, roll], axis=1))


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a camera with a pitched mount sees that only turns: a wall of noise, drawn by its homographies."""
    path = tmp_path_factory.mktemp("film") / "film.mp4"
    rng = np.random.default_rng(4)
    wall = cv2.resize(rng.integers(0, 255, (300, 400), dtype=np.uint8), (1600, 1200), interpolation=cv2.INTER_CUBIC)
    K = np.array([[FX, 0.0, 159.5], [0.0, FX, 119.5], [0.0, 0.0, 1.0]])
    K_wall = np.array([[600.0, 0.0, 800.0], [0.0, 600.0, 600.0], [0.0, 0.0, 1.0]])
    frd_from_cam = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    mount = matrix_from_euler(0.0, np.radians(MOUNT_PITCH_DEG), 0.0)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), FPS, SIZE)
    for angles in angles_rad(np.arange(int(FPS * SECONDS)) / FPS):
        R_wall_from_cam = frd_from_cam.T @ matrix_from_euler(*angles) @ mount @ frd_from_cam
        to_picture = K @ R_wall_from_cam.T @ np.linalg.inv(K_wall)
        writer.write(cv2.cvtColor(cv2.warpPerspective(wall, to_picture, SIZE), cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


def flown(film: Path, angles: FloatArray, late_s: float = 0.0) -> ImportedFlight:
    """The craft's angles at 50 a second from 5 s before the film on."""
    time_s = np.arange(-5.0, SECONDS + 5.0, 0.02)
    q = np.array([quaternion_from_euler(*one) for one in angles])
    lens, frames, _ = film_of(film)
    craft = Attitudes(time_s + late_s, q, unknown(len(q), 3))
    return ImportedFlight("a", None, craft=craft, lens=lens, frames=frames)


def mounted(pitch_deg: float) -> CameraConfig:
    return CameraConfig(width=320, height=240, fx=FX, fy=FX, cx=159.5, cy=119.5, mount=MountConfig(pitch_deg=pitch_deg))


TRUE = angles_rad(np.arange(-5.0, SECONDS + 5.0, 0.02))


def test_true_angles_are_not_doubted(film: Path) -> None:
    found = turning_of(flown(film, TRUE), mounted(MOUNT_PITCH_DEG))
    assert found is not None and (found.late_s, found.unlike, found.astray_deg) == (0.0, (), 0.0)


@pytest.mark.parametrize("late_s", [-1.4, 0.7, 2.0])
def test_angles_that_come_late_say_by_how_much(film: Path, late_s: float) -> None:
    found = turning_of(flown(film, TRUE, late_s), mounted(MOUNT_PITCH_DEG))
    assert found is not None and not found.unlike
    assert found.late_s == pytest.approx(late_s, abs=0.05)


def test_a_frozen_yaw_is_doubted_by_as_much_as_it_errs(film: Path) -> None:
    angles = TRUE.copy()
    angles[:, 0] = np.radians(-2.0)
    found = turning_of(flown(film, angles), mounted(MOUNT_PITCH_DEG))
    assert found is not None and "yaw" in found.unlike and "pitch" not in found.unlike
    assert 6.0 < found.yaw_deg < 20.0


def test_angles_that_stand_still_are_doubted_on_all_axes(film: Path) -> None:
    found = turning_of(flown(film, np.zeros_like(TRUE)), mounted(MOUNT_PITCH_DEG))
    assert found is not None and found.late_s == 0.0 and set(found.unlike) == {"pitch", "yaw", "roll"}


def test_without_a_film_nothing_is_said(film: Path) -> None:
    assert turning_of(replace(flown(film, TRUE), frames=None), mounted(0.0)) is None


def test_a_mount_that_nobody_told_is_fitted_with_the_clock(film: Path) -> None:
    """With 0, 0, 0 for it the offset would be wrong by more than its sigma says."""
    flight = flown(film, TRUE, 3.0)
    tie = tie_clocks(flight, mounted(0.0), is_mount_told=False)
    assert tie.offset_s == pytest.approx(3.0, abs=max(0.01, 3.0 * tie.sigma_s))
    assert tie.mount_deg is not None
    np.testing.assert_allclose(tie.mount_deg, [0.0, MOUNT_PITCH_DEG, 0.0], atol=1.5)
    told = tie_clocks(flight, mounted(MOUNT_PITCH_DEG))
    assert told.mount_deg is None and told.offset_s == pytest.approx(3.0, abs=max(0.01, 3.0 * told.sigma_s))
