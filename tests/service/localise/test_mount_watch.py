"""The mount over the flight: when it is told, with which sign, and the line that names the key to set."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distloc.scenery.compass import CompassState
from distloc.types import PoseErrors
from service.config.load import load_config
from service.config.sections import MountConfig
from service.localise.mount_watch import MountState, MountWatch, mount_line
from service.recordings.recording import Recording
from service.recordings.replay import Replay
from service.simulator.simulate import simulate
from tests.distloc.calibration.test_scenery_mount import OLD_DEG, TOLD, TRUE_DEG, flight
from tests.service.commands.calibrate.test_by_scenery import SCENE

OLD = MountConfig(*OLD_DEG.tolist())


def told(seed: int, turns: float, told: PoseErrors = TOLD, count: int = 120) -> tuple[MountWatch, list[CompassState]]:
    watch, said = MountWatch(OLD, told), []
    for one in flight(seed, turns, count, 120.0):
        pose = replace(one.pose, errors=one.errors)
        said.append(CompassState(one.error_rad, one.covariance_rad2, 40, 0, pose.stamp_s, 0.0, 0.02, pose))
        watch.note(said[-1])
    return watch, said


def test_the_error_is_the_configs_minus_the_mounts() -> None:
    state = told(1, 1.0)[0].state
    assert state is not None and math.degrees(state.turned_rad) == pytest.approx(357.0, abs=3.0)
    for number in range(3):
        error_rad, sigma_rad = state.error_rad[number], state.sigma_rad[number]
        assert error_rad is not None and sigma_rad is not None
        assert sigma_rad < (TOLD.heading_bias_rad, TOLD.tilt_bias_rad, TOLD.tilt_bias_rad)[number]
        off_deg = math.degrees(error_rad) - (OLD_DEG - TRUE_DEG)[number]
        assert abs(off_deg) < 3.0 * math.degrees(sigma_rad)


def test_what_is_no_surer_than_told_is_not_told() -> None:
    watch = MountWatch(OLD, TOLD)
    assert watch.state is None
    assert told(1, 0.0, count=19)[0].state is None  # too few
    survey = replace(TOLD, heading_bias_rad=float(np.radians(0.3)), tilt_bias_rad=float(np.radians(5.0)))
    state = told(1, 1.0, told=survey)[0].state
    assert state is not None and state.error_rad[0] is None and state.sigma_rad[0] is None
    assert state.error_rad[1] is not None


def test_a_keyframe_counts_once_and_one_without_a_covariance_begins_anew() -> None:
    watch, said = told(1, 1.0)
    before = watch.state
    watch.note(said[-1])
    assert watch.state == before
    for number, wrong in enumerate((-np.eye(3), np.diag([1.0, 1.0, 0.0]), np.full((3, 3), 1e-4))):
        watch.note(replace(said[-1], stamp_s=1e3 + number, covariance_rad2=wrong))
        assert watch.state is None


def test_the_line_names_the_key_that_is_surely_off() -> None:
    assert mount_line(None, OLD) is None
    sigmas = (None, *np.radians([0.4, 0.4]))
    assert mount_line(MountState((None, *np.radians([1.5, 0.4])), sigmas, 1.0), OLD) is None
    small = MountState((None, *np.radians([0.45, 0.0])), (None, *np.radians([0.1, 0.1])), 1.0)
    assert mount_line(small, OLD) is None
    off, where = (
        MountState((None, *np.radians([-2.0, 0.0])), sigmas, 7.0),
        "the mount is off, by the scenery over 360 deg",
    )
    assert mount_line(off, OLD) == (f"{where} of heading: camera.mount.pitch_deg is -6, set it to -4.0 (+- 0.4)")


def test_a_replay_says_that_the_pitch_is_off(tmp_path: Path) -> None:
    simulate(tmp_path / "flight", SCENE, 3, lambda share: None)
    config = tmp_path / "flight/config.toml"
    text = config.read_text(encoding="utf-8")
    config.write_text(text.replace("pitch_deg = -15.0", "pitch_deg = -12.0"), encoding="utf-8")
    run = Replay(Recording(tmp_path / "flight"), load_config(config), seed=0)
    run.run(lambda report: None, lambda stamp_ns: None)
    line, said = run.outcome().mount, run.status()["scenery"]
    assert line is not None and "camera.mount.pitch_deg is -12, set it to -1" in line
    assert "yaw_deg" not in line
    assert said["mount_error_deg"][1] == pytest.approx(3.0, abs=3.0 * said["mount_sigma_deg"][1])
