"""A flight by formula, its pictures, and what a replay makes of a recording of it: for round trips of importers."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import typer.testing

from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.rotations import R_cam_from_enu, heading_rad, matrix_from_euler
from distloc.types import FloatArray
from service.commands.cli import app
from service.config.load import load_config
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording

EPOCH_S = 1_784_000_000.0  # 2026-07-14
LAT_DEG, LON_DEG, ALT_MSL_M = 47.4275, 8.6056, 540.0
HOME_ALT_M, UNDULATION_M = 430.0, 47.5
EARTH_M = 6_371_000.0
SIZE = (64, 48)
PICTURES_S = np.arange(2.03, 18.0, 1.37)


@dataclass(frozen=True, slots=True)
class Flown:
    """20 s in a gentle curve that rocks by degrees; times (N,) in, angles in degrees out, as logs have them."""

    duration_s: float = 20.0

    def times_s(self, rate_hz: float) -> FloatArray:
        return np.arange(0.0, self.duration_s, 1.0 / rate_hz)

    def angles_deg(self, t_s: FloatArray) -> FloatArray:
        """Yaw in 0 to 360, pitch, roll (3, N)."""
        yaw = (350.0 + 1.5 * t_s + 2.0 * np.sin(0.9 * t_s)) % 360.0
        return np.stack([yaw, 4.0 * np.sin(0.7 * t_s), 5.0 * np.sin(0.5 * t_s + 1.0)])

    def velocity_mps(self, t_s: FloatArray) -> FloatArray:
        """North, east, down (3, N)."""
        return np.stack([10.0 + np.sin(0.3 * t_s), 2.0 * np.cos(0.2 * t_s), -0.5 * np.ones(len(t_s))])

    def place(self, t_s: FloatArray) -> FloatArray:
        """Latitude, longitude in degrees, metres over the sea (3, N)."""
        north_m = 10.0 * t_s + (1.0 - np.cos(0.3 * t_s)) / 0.3
        east_m = 10.0 * np.sin(0.2 * t_s)
        lat = LAT_DEG + np.degrees(north_m / EARTH_M)
        return np.stack([lat, LON_DEG + np.degrees(east_m / EARTH_M / np.cos(np.radians(lat))), ALT_MSL_M + 0.5 * t_s])


def write_pictures(folder: Path, shift_s: float = 0.0) -> Path:
    """A folder of pictures, each unlike the others, with a frames.csv."""
    (folder / "frames").mkdir(parents=True)
    rng = np.random.default_rng(2)
    lines = ["stamp_us,file"]
    for number, t_s in enumerate(PICTURES_S):
        image = rng.integers(0, 255, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        assert cv2.imwrite(str(folder / "frames" / f"{number}.png"), image)
        lines.append(f"{round((EPOCH_S + t_s + shift_s) * 1e6)},{number}.png")
    (folder / "frames.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def imported(*arguments: object) -> tuple[int, str]:
    """`distloc import` as a user runs it: the exit code, and what it says."""
    done = typer.testing.CliRunner().invoke(app, ["import", *map(str, arguments)])
    said = done.output + (
        "" if done.exception is None or isinstance(done.exception, SystemExit) else f"{done.exception}"
    )
    return done.exit_code, said


@dataclass(frozen=True, slots=True)
class Errors:
    """Of the poses that the replay gives its frames, against the flight: the worst ones."""

    attitude_deg: float
    position_m: float
    frames: int


def replayed(
    recording: Path, mount_deg: tuple[float, float, float] = (0.0, 0.0, 0.0), flown: Flown | None = None
) -> Errors:
    """What the code that flies makes of a recording: the camera's pose at each frame, beside the truth."""
    flown = flown or Flown()
    posed = PosedFrames(Recording(recording), load_config(recording / "config.toml"))
    off_deg, off_m = [0.0], [0.0]
    for frame, pose in posed.pairs(lambda stamp_ns: None):
        t_s = np.array([frame.stamp_ns * 1e-9 - EPOCH_S])
        R_ned_from_body = matrix_from_euler(*np.radians(flown.angles_deg(t_s)[:, 0]))
        R = R_cam_from_enu(R_ned_from_body, matrix_from_euler(*np.radians(mount_deg)))
        off_deg.append(angle_deg(R @ pose.R_cam_from_enu.T))
        frame_enu = posed.autopilot.frame_enu
        assert isinstance(frame_enu, LocalFrame)
        off_m.append(float(np.linalg.norm(pose.position_enu_m - frame_enu.enu_from_geodetic(*flown.place(t_s)[:, 0]))))
        assert pose.heading_rad is None or abs(heading_rad(R_ned_from_body) - pose.heading_rad) < 1.0 or mount_deg
    return Errors(max(off_deg), max(off_m), len(off_deg) - 1)


def angle_deg(R: FloatArray) -> float:
    """How far a rotation (3, 3) turns."""
    return float(np.degrees(np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2.0))
