"""Scenarios: their geometry as the camera sees it, their files, and what they say of the truth."""

from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest

from distloc.backports import tomllib
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.sensor import CameraFaults
from service.config.sections import Config, ConfigError
from service.simulator.drawn_scene import faults_of
from service.simulator.scenario import (
    Landscape,
    PathSection,
    Scenario,
    base_enu_m,
    camera_pose,
    centre_enu_m,
    load_scenario,
    service_config_toml,
    truth_json,
)

TARGET = "[[targets]]\neast_m = 1000\nnorth_m = 1000\n"
NAMES = ["demo", "two_fires", "straight", "hover"]


@pytest.mark.parametrize("name", NAMES)
def test_plumes_stay_in_view(name: str) -> None:
    scenario = load_scenario(name)
    camera = scenario.camera.camera()
    for target in scenario.targets:
        side = np.array([target.width_m / 2, target.width_m / 2, 0.0])
        top = base_enu_m(target) + np.array([0.0, 0.0, target.height_m])
        corners = np.stack([end + sign * side for end in (base_enu_m(target), top) for sign in (-1, 1)], axis=1)
        for t_s in np.arange(0.0, 60.01, 0.2):
            pose = camera_pose(scenario, float(t_s), float(t_s))
            _, inside = camera.project(pose.R_cam_from_enu @ (corners - pose.position_enu_m[:, None]))
            assert inside.all(), f"out of view at {t_s:.1f} s"


def test_demo_has_baseline_for_its_range() -> None:
    scenario = load_scenario("demo")
    first, last = (camera_pose(scenario, t_s, t_s).position_enu_m for t_s in (0.0, 40.0))
    centre = centre_enu_m(scenario.targets[0])
    first_range_m, last_range_m = np.linalg.norm(centre - first), np.linalg.norm(centre - last)
    assert 2200 < first_range_m < 2500
    assert np.linalg.norm(last - first) > 0.35 * max(first_range_m, last_range_m)
    assert first[2] == pytest.approx(120.0)


@pytest.mark.parametrize("turn_rate_dps", [-3.0, 3.0])
def test_arc_starts_on_its_course_and_turns_to_its_side(turn_rate_dps: float) -> None:
    path = PathSection(
        kind="arc", east_m=5.0, north_m=7.0, course_deg=30.0, speed_mps=20.0, turn_rate_dps=turn_rate_dps
    )
    flight = Scenario(path=path).flight
    start, later = flight.state(0.0), flight.state(10.0)
    np.testing.assert_allclose(start.position_enu_m, [5.0, 7.0, 120.0], atol=1e-9)
    np.testing.assert_allclose(start.velocity_enu_mps, [10.0, 20.0 * np.cos(np.pi / 6), 0.0], atol=1e-9)
    course_deg = np.degrees(np.arctan2(later.velocity_enu_mps[0], later.velocity_enu_mps[1]))
    assert course_deg == pytest.approx(30.0 + 10.0 * turn_rate_dps)


def test_truth_is_at_the_plume() -> None:
    scenario = load_scenario("two_fires")
    targets = truth_json(scenario)["targets"]
    assert len(targets) == 2
    for target, truth in zip(scenario.targets, targets, strict=True):
        base, centre = truth["base"], truth["centre"]
        assert truth["size_m"] == target.height_m
        position = scenario.frame.enu_from_geodetic(base["lat"], base["lon"], base["alt_msl_m"])
        np.testing.assert_allclose(position, base_enu_m(target), atol=2e-3)
        assert 0.3 * target.height_m < centre["alt_msl_m"] - base["alt_msl_m"] < 0.7 * target.height_m


def test_config_text_is_what_the_service_reads() -> None:
    scenario = load_scenario("demo")
    config = msgspec.convert(tomllib.loads(service_config_toml(scenario)), Config)
    assert config.camera == scenario.camera


def test_file(tmp_path: Path) -> None:
    path = tmp_path / "one.toml"
    path.write_text("duration_s = 7\n[path]\nspeed_mps = 9\n[[targets]]\neast_m = 900\nnorth_m = 0\n")
    scenario = load_scenario(str(path))
    assert (scenario.duration_s, scenario.path.speed_mps, scenario.targets[0].east_m) == (7.0, 9.0, 900.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "targets"),
        ("fps = ", "TOML"),
        ("speed = 3", "speed"),
        ("fps = -1", "fps"),
        ("[[targets]]\neast_m = 1\nnorth_m = 1\n[errors]\nlatency_ms = [9, 2]", "latency_ms"),
        ("[[targets]]\neast_m = 1\nnorth_m = 1\n[path]\nkind = 'arc'", "turn_rate_dps"),
        ("[[targets]]\neast_m = nan\nnorth_m = 1", "finite"),
        ("landscape = 'moon'", "landscape"),
        ("[camera_faults]\nreadout_ms = -1", "readout_ms"),
        ("[camera_faults]\nexposure_ms = 200", "exposure_ms"),
        ("[camera_faults]\njpeg_quality = 5", "jpeg_quality"),
        (f"landscape = 'hills'\n[path]\nheight_m = 60\n{TARGET}", "path.height_m is 60.*100 or more"),
        (f"landscape = 'night'\nduration_s = 400\n{TARGET}", "11200 m from the origin.*mountains from 6000 m"),
    ],
)
def test_wrong_file_is_one_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=says) as caught:
        load_scenario(str(path))
    assert "\n" not in str(caught.value)


def test_landscapes_are_those_that_can_be_drawn() -> None:
    assert set(get_args(Landscape)) == set(SCENES)


def test_a_file_names_its_landscape_and_the_cameras_faults(tmp_path: Path) -> None:
    path = tmp_path / "one.toml"
    path.write_text(f"landscape = 'snow'\n[camera_faults]\nreadout_ms = 20\njpeg_quality = 60\n{TARGET}")
    scenario = load_scenario(str(path))
    assert scenario.landscape == "snow"
    assert faults_of(scenario.camera_faults) == CameraFaults(readout_s=0.02, jpeg_quality=60)
    assert load_scenario("demo").landscape == "hills"
    path.write_text(f"landscape = 'sea'\nduration_s = 400\n[path]\nheight_m = 20\n{TARGET}")
    assert load_scenario(str(path)).landscape == "sea"  # neither hills nor mountains


def test_unknown_name_lists_the_known() -> None:
    with pytest.raises(ConfigError, match="demo, hover, patrol, straight, two_fires"):
        load_scenario("nowhere")
