"""The localise stage: settings that reach the localizer, the ground made when it can be, a check of its files."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.filter.ground import FlatGround, Ground
from distloc.filter.settings import ENOUGH_PARTICLES, LocalizerConfig
from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.rotations import R_ENU_FROM_NED
from distloc.localizer import Localizer
from distloc.study.scenes import PAPER_CAMERA, paper_scene
from distloc.types import CameraPose, Ellipse, Plume, TargetState
from service.autopilot.autopilot import Autopilot
from service.commands.check.doctor import run_check
from service.commands.demo.bias_blind import BiasBlind
from service.common.messages import Frame
from service.config.sections import Config, GroundConfig, LocaliserSection, MavlinkConfig, MountConfig
from service.localise.ground_prior import GroundKeeper
from service.localise.stage import Localised, LocaliseStage, Locator, localizer_config
from service.mavlink.framer import Framer
from service.segmenters.segment import make_segmenter
from tests.support.estimates import estimate

BIAS_RAD = float(np.radians(2.0))


class Flown:
    """An autopilot that hears what a test sends."""

    def __init__(self) -> None:
        self.autopilot = Autopilot(MavlinkConfig(), MountConfig())
        self._now_ns = 1_000_000_000
        self._hear(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))
        self._hear(mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 100_000, 0, 0, 0, 0, 9, 147_000))

    def position(self, alt_m: float, over_home_m: float) -> None:
        heights_mm = (round(alt_m * 1e3), round(over_home_m * 1e3))
        boot_ms = self._now_ns // 1_000_000
        self._hear(
            mavlink.MAVLink_global_position_int_message(boot_ms, 400_000_000, 30_000_000, *heights_mm, 0, 0, 0, 0)
        )

    def home(self, alt_m: float) -> None:
        self._hear(
            mavlink.MAVLink_home_position_message(
                400_000_000, 30_000_000, round(alt_m * 1e3), 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            )
        )

    def _hear(self, message: Any) -> None:
        (frame,) = Framer().feed(bytes(message.pack(mavlink.MAVLink(None, 1, 1))))
        self.autopilot.receive(frame, self._now_ns)
        self._now_ns += 50_000_000


def test_home_is_what_the_autopilot_says_or_what_its_heights_imply() -> None:
    flown = Flown()
    assert flown.autopilot.place.home_alt_msl_m is None
    flown.position(150.0, 40.0)
    assert flown.autopilot.place.home_alt_msl_m is None  # one alone may be false
    flown.position(150.0, 40.0)
    assert flown.autopilot.place.home_alt_msl_m == pytest.approx(110.0)
    flown.home(112.5)
    flown.position(150.0, 40.0)
    assert flown.autopilot.place.home_alt_msl_m == pytest.approx(112.5)


def test_ground_waits_for_the_origin_and_follows_home() -> None:
    flown, got = Flown(), list[Ground]()
    keeper = GroundKeeper(GroundConfig(kind="flat"), flown.autopilot, got.append)
    keeper.ask()
    assert got == []
    assert keeper.counters() == {"asked": "flat", "used": "none", "reasons": {}}
    for over_home_m in (40.0, 40.0, 38.0):  # 2 m are the EKF's drift
        flown.position(150.0, over_home_m)
        keeper.ask()
    flown.home(170.0)
    keeper.ask()
    keeper.ask()
    assert [ground.up_m for ground in got if isinstance(ground, FlatGround)] == pytest.approx([-40.0, 20.0])
    assert keeper.counters() == {"asked": "flat", "used": "flat", "reasons": {}}


def test_off_is_never_made() -> None:
    flown, got = Flown(), list[Ground]()
    flown.position(150.0, 40.0)
    GroundKeeper(GroundConfig(), flown.autopilot, got.append).ask()
    assert got == []


def test_every_key_of_the_section_reaches_the_localizer() -> None:
    section = LocaliserSection(
        n_particles=500,
        particle_sigma_m=3.0,
        step_distance_m=20.0,
        step_interval_s=2.0,
        max_targets=2,
        aim="base",
        range_m=(60.0, 9000.0),
        dismissal_misses=7,
        seed=4,
    )
    config = Config(localizer=section)
    segmenter = make_segmenter(config.segmenter, config.camera.camera())
    stage = LocaliseStage(config, segmenter, Flown().autopilot)
    asked = msgspec.structs.asdict(section)
    asked.pop("seed")
    assert {key: getattr(stage.localizer._config, key) for key in asked} == asked


def test_a_target_has_no_more_particles_than_tell_anything() -> None:
    of_default = localizer_config(LocaliserSection())
    assert of_default.n_particles == ENOUGH_PARTICLES == LocalizerConfig().n_particles
    assert of_default == LocalizerConfig()
    assert localizer_config(LocaliserSection(n_particles=300)).n_particles == 300
    assert localizer_config(LocaliserSection(filter="bootstrap")).n_particles == 100_000  # the paper's


@pytest.mark.parametrize(
    ("name", "content", "passes", "line"),
    [
        ("N47E008.hgt", bytes(2 * 1201 * 1201), True, "ok    ground: 1 DEM file in "),
        ("N47E008.hgt", b"short", False, "fail  ground: "),
        ("notes.txt", b"", False, "fail  ground: "),
    ],
)
def test_check_opens_the_dem(tmp_path: Path, name: str, content: bytes, passes: bool, line: str) -> None:
    (tmp_path / name).write_bytes(content)
    said: list[str] = []
    config = Config(ground=GroundConfig(kind="dem", path=str(tmp_path)))
    assert asyncio.run(run_check(config, said.append, 1.0)) is passes
    (ground,) = [one for one in said if "ground" in one]
    assert ground.startswith(line)
    assert str(tmp_path) in ground


def test_bias_blind_is_sure_and_wrong_where_the_compass_is_wrong() -> None:
    scene = paper_scene()
    config = Config(localizer=LocaliserSection(n_particles=5000))
    blind, seeing = BiasBlind(config), Localizer(PAPER_CAMERA, LocalizerConfig(), rng=np.random.default_rng(0))
    c, s = np.cos(BIAS_RAD), np.sin(BIAS_RAD)
    turn = R_ENU_FROM_NED @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ R_ENU_FROM_NED.T
    for stamp_s in scene.flight.stamps_s:
        pose = scene.flight.pose_at(float(stamp_s))
        mask = np.zeros((1080, 1920), np.uint8)
        scene.target.draw(mask, PAPER_CAMERA, pose)
        errors = config.pose_errors.pose_errors()
        reported = CameraPose(pose.stamp_s, pose.position_enu_m, pose.R_cam_from_enu @ turn, errors)
        blind.see(Localised(Frame(0, "", None), reported, mask, ()))
        (one,) = seeing.step(reported, mask) or [None]
    truth_enu_m = scene.target.centre_enu_m(0.0)
    other = blind.nearest(truth_enu_m)
    assert one is not None
    assert other is not None
    assert ellipse_holds(one.ellipse95, (truth_enu_m - one.position_enu_m)[:2])
    assert not ellipse_holds(other.ellipse95, (truth_enu_m - other.position_enu_m)[:2])
    assert other.ellipse95.semi_major_m < 0.5 * one.ellipse95.semi_major_m


def test_what_is_not_finite_is_never_passed_on() -> None:
    flown = Flown()
    flown.position(150.0, 40.0)
    flown.position(150.0, 40.0)
    plain = estimate(1, TargetState.CONFIRMED, np.zeros(3), np.eye(3), Ellipse(2.0, 1.0, 0.0), 9)
    locator, sound = Locator(flown.autopilot), replace(plain, plume=Plume(np.zeros(3), 0.1, 2.0))
    (located,) = locator.locate((sound,), 0)
    assert located.plume_place is not None
    for wrong in (
        replace(sound, position_enu_m=np.full(3, np.nan)),
        replace(sound, covariance_enu_m2=np.full((3, 3), np.inf)),
        replace(sound, plume=Plume(np.array([0.0, np.nan, 0.0]), 0.1, 2.0)),
        replace(sound, plume=Plume(np.zeros(3), np.nan, 2.0)),
        replace(sound, plume=Plume(np.zeros(3), 0.1, np.inf)),
    ):
        assert locator.locate((wrong,), 0) == []
