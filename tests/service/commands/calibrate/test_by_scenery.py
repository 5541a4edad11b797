"""`calibrate` without a landmark, on a drawn flight whose camera is mounted otherwise than the config says."""

import re
from pathlib import Path

import msgspec
import pytest

from service.commands.calibrate.calibrate import run_calibrate
from service.config.sections import CameraConfig, MountConfig
from service.recordings.recording import Recording, RecordingError
from service.simulator.scenario import ErrorSection, PathSection, PlumeSection, Scenario
from service.simulator.simulate import simulate
from tests.support.places import CUT

SCENE = Scenario(
    path=PathSection(kind="arc", speed_mps=20.0, turn_rate_dps=4.0),
    targets=(PlumeSection(east_m=-2000.0, north_m=1100.0),),
    camera=CameraConfig(
        width=480, height=270, fx=340.0, fy=340.0, cx=239.5, cy=134.5, mount=MountConfig(yaw_deg=-60.0, pitch_deg=-15.0)
    ),
    errors=ErrorSection(heading_bias_deg=0.5, tilt_bias_deg=0.1, position_sigma_m=0.5),
    landscape="hills",
    fps=4.0,
    duration_s=40.0,
)


def printed(recording: Path, config: Path) -> dict[str, tuple[float, float]]:
    """Each angle and its sigma in degrees."""
    lines: list[str] = []
    run_calibrate(Recording(recording), config, None, None, False, lines.append)
    text = "\n".join(lines)
    assert "by the scenery in" in text and "the focal length is" in text
    found = re.findall(r"(\w+)_deg = (\S+) .*sigma (\S+?)[;\n]", text + "\n")
    return {name: (float(value), float(sigma)) for name, value, sigma in found}


def test_the_mount_comes_out(tmp_path: Path) -> None:
    simulate(tmp_path / "flight", SCENE, 3, lambda share: None)
    believed = (tmp_path / "flight/config.toml").read_text(encoding="utf-8")
    config = tmp_path / "believed.toml"
    config.write_text(
        believed.replace("yaw_deg = -60.0", "yaw_deg = -64.0").replace("pitch_deg = -15.0", "pitch_deg = -13.5"),
        encoding="utf-8",
    )
    found = printed(tmp_path / "flight", config)
    for name, true_deg in (("yaw", -60.0), ("pitch", -15.0), ("roll", 0.0)):
        value, sigma = found[name]
        assert abs(value - true_deg) < 3.0 * sigma, (name, value, sigma)
    assert abs(found["yaw"][0] + 60.0) < 1.5 and abs(found["pitch"][0] + 15.0) < 0.7


def test_a_recording_without_pictures_says_so() -> None:
    with pytest.raises(RecordingError, match="told the attitude in 0 keyframes, 20 are needed"):
        run_calibrate(Recording(CUT), None, None, None, False, lambda line: None)


def test_a_straight_flight_that_is_too_short_says_so(tmp_path: Path) -> None:
    short = msgspec.structs.replace(SCENE, duration_s=5.0)
    simulate(tmp_path / "flight", short, 4, lambda share: None)
    with pytest.raises(RecordingError, match="keyframes, 20 are needed"):
        run_calibrate(Recording(tmp_path / "flight"), None, None, None, False, lambda line: None)
