"""Corners of a real film along a sea cliff: how the camera turned by them, beside the sea's horizon.

A drone flies at 16 m and a few m/s; about a quarter of the corners lie on surf, where the compass' window would have to
find them out. Here they are left out by hand: what is asked is how well corners on land stay on their places.

The lens' distortion is of this film: with none the horizon's roll runs away from that of the corners by 0.16 and 0.11
degrees a second in the film's halves; that is least at -0.125 by the first half and at -0.123 by the second.
"""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_rotation_vector
from distloc.scenery.corner_tracker import CornerTracker
from distloc.types import CameraPose, FloatArray
from tests.support.places import DATA

KARMA = DATA / "karma"
CAMERA = Camera(854, 480, 467.0, 467.0, 426.5, 239.5, distortion=(-0.12, 0.0, 0.0, 0.0))
FPS, FRAMES = 29.97, 345  # after frame 345 the horizon's line is lost
LEVEL_NORTH = R_cam_from_enu(np.eye(3), np.eye(3))
_CORE_PX = 0.3


def horizons(path: Path) -> FloatArray:
    """Unit normals (n, 3) of the planes through the camera and the sea's horizon, upwards, in the camera's axes.

    The lines are of the film's own pixels, at its left, where the sea is.
    """
    with path.open(encoding="ascii", newline="") as file:
        lines = [[float(row["v_at_centre_px"]), float(row["slope_dv_du"])] for row in csv.DictReader(file)]
    u = np.linspace(10.0, 330.0, 30)
    normals = [np.linalg.svd(CAMERA.rays(np.stack([u, v + slope * (u - CAMERA.cx)])).T)[2][2] for v, slope in lines]
    return np.stack([normal if normal[1] < 0.0 else -normal for normal in normals])


def is_land(pixel: FloatArray) -> bool:
    """Right of the surf, wherever the film has it."""
    return bool(pixel[0] > 360.0 - 0.35 * max(pixel[1] - CAMERA.cy, 0.0))


def off_px(before: FloatArray, now: FloatArray, turn_and_way: FloatArray) -> FloatArray:
    """How far rays (n, 3) are from the epipolar lines of those before, by a rotation vector and a way (x, y, 1)."""
    x, y = turn_and_way[3:]
    E = np.array([[0.0, -1.0, y], [1.0, 0.0, -x], [-y, x, 0.0]]) @ matrix_from_rotation_vector(turn_and_way[:3])
    lines, back = before @ E.T, now @ E
    length = np.sqrt(np.square(lines[:, :2]).sum(axis=1) + np.square(back[:, :2]).sum(axis=1))
    return np.asarray(CAMERA.fx * np.einsum("ni,ni->n", now, lines) / length)


def turned(before: FloatArray, now: FloatArray) -> FloatArray:
    """The rotation (3, 3) from pixels (n, 2) to pixels (n, 2) of places that stand still; what errs weighs less."""
    rays = [(rays / rays[2]).T for rays in (CAMERA.rays(px.T) for px in (before, now))]
    x = np.zeros(5)
    for _ in range(20):
        r = off_px(*rays, x)
        J = np.stack([(off_px(*rays, x + step) - r) / 1e-5 for step in 1e-5 * np.eye(5)], axis=1)
        weight = 1.0 / np.sqrt(1.0 + np.square(r / _CORE_PX))
        x = x - np.linalg.lstsq(J * weight[:, None], r * weight, rcond=None)[0]
    return matrix_from_rotation_vector(x[:3])


@pytest.fixture(scope="module")
def seen() -> list[dict[int, FloatArray]]:
    """Each frame's corners by name."""
    tracker, film = CornerTracker(CAMERA, 200), cv2.VideoCapture(str(KARMA / "karma.mp4"))
    out = []
    for number in range(FRAMES):
        image = np.asarray(film.read()[1], dtype=np.uint8)
        pose = CameraPose(number / FPS, np.array([0.0, 4.0 * number / FPS, 16.0]), LEVEL_NORTH)
        corners = tracker.track(image, pose)
        out.append(dict(zip(corners.names.tolist(), corners.pixels.T, strict=True)))
    film.release()
    return out


@pytest.mark.thorough
@pytest.mark.skipif(not KARMA.is_dir(), reason="no shared data")
@pytest.mark.parametrize("span", [15, 30])
def test_corners_turn_as_the_sea_horizon_does(seen: list[dict[int, FloatArray]], span: int) -> None:
    """Over half a second and a whole one; the horizon's own slope is no surer than some hundredths of a degree."""
    up = horizons(KARMA / "sea_horizon.csv")
    off = []
    for start in range(0, FRAMES - span, 3):
        before, now = seen[start], seen[start + span]
        names = [name for name in before if name in now and is_land(before[name]) and is_land(now[name])]
        assert len(names) >= 20
        R = turned(np.array([before[name] for name in names]), np.array([now[name] for name in names]))
        off.append(np.degrees(R @ up[start] - up[start + span]))
    roll_deg, _, pitch_deg = np.array(off).T
    assert 0.003 < np.sqrt(np.square(pitch_deg).mean()) < 0.03
    assert 0.003 < np.sqrt(np.square(roll_deg).mean()) < 0.05
    assert abs(roll_deg.mean()) < 0.03
