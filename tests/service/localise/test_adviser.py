"""Advice in the service: what the config makes of the craft, when it is asked for, and that nothing waits for it."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.flights import flight_past
from distloc.simulation.mask_noise import MaskNoise
from distloc.simulation.pose_noise import NoPoseNoise
from distloc.simulation.sequences import simulate_sequence
from distloc.simulation.targets import Box
from distloc.study.scenes import PAPER_CAMERA
from distloc.types import TargetEstimate, TargetState
from service.config.camera_section import CameraConfig, MountConfig
from service.config.sections import AdviceConfig, Config
from service.localise.adviser import AdviceWorker, Adviser, craft_of

TARGET = np.array([0.0, 1500.0, 100.0])


@pytest.fixture(scope="module")
def flown() -> tuple[Localizer, list[TargetEstimate], float]:
    """After 200 m of a flight past a box."""
    localizer = Localizer(PAPER_CAMERA, LocalizerConfig(n_particles=2000), rng=np.random.default_rng(1))
    flight = flight_past("perpendicular", TARGET, 1500.0, 200.0, height_m=120.0)
    estimates: list[TargetEstimate] = []
    for sample in simulate_sequence(
        PAPER_CAMERA, flight, [Box(TARGET)], MaskNoise(), NoPoseNoise(), np.random.default_rng(2)
    ):
        estimates = localizer.step(sample.pose, sample.mask)
    return localizer, estimates, sample.pose.stamp_s


def test_the_config_says_how_the_craft_flies() -> None:
    gimbal = Config(camera=CameraConfig(mount=MountConfig(gimbal=True)))
    assert craft_of(gimbal).keeps_target and craft_of(gimbal).has_gimbal and craft_of(gimbal).is_nose_along
    fixed = craft_of(Config(camera=CameraConfig(hfov_deg=80.0), advice=AdviceConfig(speed_mps=15.0, flight_s=40.0)))
    assert (fixed.keeps_target, fixed.speed_mps, fixed.flight_s) == (False, 15.0, 40.0)
    assert np.degrees(fixed.half_view_rad) == pytest.approx(0.8 * 40.0, abs=0.5)
    sideways = craft_of(
        Config(advice=AdviceConfig(nose="target"), camera=CameraConfig(mount=MountConfig(yaw_deg=90.0)))
    )
    assert sideways.keeps_target and not sideways.is_nose_along
    assert sideways.camera_yaw_rad == pytest.approx(np.pi / 2.0)


def test_a_fire_that_is_not_sure_gets_advice_and_a_sure_one_none(
    flown: tuple[Localizer, list[TargetEstimate], float],
) -> None:
    localizer, (one,), stamp_s = flown
    adviser = Adviser(Config(advice=AdviceConfig(nose="target")))
    adviser.ask(localizer, [one], stamp_s)
    advice = adviser.current(one.id, stamp_s)
    assert advice is not None and advice.target == one.id and advice.likely_m < 0.8 * one.ellipse95.semi_major_m
    assert adviser.current(one.id, stamp_s + 31.0) is None and adviser.current(one.id, stamp_s - 1.0) is None
    assert adviser.current(99, stamp_s) is None
    for other in (
        replace(one, ellipse95=replace(one.ellipse95, semi_major_m=99.0)),
        replace(one, state=TargetState.COASTING),
        replace(one, misses=1),
    ):
        adviser.ask(localizer, [other], stamp_s + 5.0)
        assert adviser.current(one.id, stamp_s + 5.0) is None
    off = Adviser(Config(advice=AdviceConfig(enabled=False)))
    off.ask(localizer, [one], stamp_s)
    assert off.current(one.id, stamp_s) is None


def test_it_is_asked_for_every_three_seconds_and_fires_take_turns(
    flown: tuple[Localizer, list[TargetEstimate], float],
) -> None:
    localizer, (one,), stamp_s = flown
    asked: list[float] = []
    adviser = Adviser(Config(), lambda job: asked.append(now_s))
    for now_s in np.arange(stamp_s, stamp_s + 10.0, 0.1):
        adviser.ask(localizer, [one], float(now_s))
    assert len(asked) == 4 and np.diff(asked) == pytest.approx(3.0, abs=0.11)
    for backwards_s in (stamp_s - 100.0, stamp_s - 96.0):  # a clock that was set goes on
        adviser.ask(localizer, [one], backwards_s)
    assert len(asked) == 6


def test_the_worker_leaves_out_what_comes_while_it_works_and_goes_on_after_a_fault() -> None:
    worker, started, may_end, done = AdviceWorker(), threading.Event(), threading.Event(), threading.Event()

    def slow() -> None:
        started.set()
        may_end.wait(20.0)

    worker(slow)
    assert started.wait(20.0)
    worker(done.set)  # left out
    may_end.set()
    worker.close()
    assert not done.is_set()
    worker = AdviceWorker()
    failed = threading.Event()

    def fail() -> None:
        failed.set()
        raise RuntimeError("as if")

    worker(fail)
    assert failed.wait(20.0)
    while not done.is_set():  # the one that failed has to come to its end
        worker(done.set)
    worker.close()
