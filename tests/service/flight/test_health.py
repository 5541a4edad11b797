"""Frames that come and are all refused: there is always a name for what lacks, and the log tells it once."""

import logging

import numpy as np
import pytest

from distloc.types import RejectReason
from service.common.degraded import Degraded
from service.config.sections import Config, ZenohConfig
from service.flight.app import App
from service.flight.health import NAMES, DegradedLog, FrameAges, degraded_names
from service.localise.scenery import FollowedScenery, SceneryState
from service.publish.wire import SceneryReport

S = 1_000_000_000
OF_STUDIES = {"one_view", "no_baseline", "behind_camera", "all_outliers"}  # of the study's triangulations, of no frame


def names(ages: FrameAges, now_ns: int, autopilot: tuple[Degraded, ...] = ()) -> tuple[Degraded, ...]:
    return degraded_names(now_ns, autopilot, ages, True, (), ())


def test_every_reason_that_a_frame_can_get_has_a_name() -> None:
    assert {str(reason) for reason in RejectReason} - OF_STUDIES == {str(reason) for reason in NAMES}


@pytest.mark.parametrize("reason", NAMES)
def test_frames_that_are_all_refused_are_told_within_four_seconds(reason: RejectReason) -> None:
    ages = FrameAges()
    for tenth in range(40):
        ages.frame_heard(tenth * S // 10)
        ages.frame_refused(reason, tenth * S // 10)
        if tenth <= 30:
            assert names(ages, tenth * S // 10) == ()
    assert names(ages, 4 * S) == (NAMES[reason],)
    ages.mask_made(4 * S)
    assert names(ages, 4 * S) == ()


def test_reasons_of_the_last_three_seconds_count_and_a_dead_link_is_told_alone() -> None:
    ages = FrameAges()
    for second in range(12):
        ages.frame_heard(second * S)
        ages.frame_refused(RejectReason.NO_FIX if second < 6 else RejectReason.NO_POSE, second * S)
    assert names(ages, 11 * S) == (Degraded.POSE,)
    assert names(ages, 11 * S, (Degraded.LINK,)) == (Degraded.LINK,)


def test_a_silent_camera_that_comes_back_has_three_seconds() -> None:
    ages = FrameAges()
    ages.frame_heard(0)
    assert names(ages, 20 * S) == (Degraded.CAMERA,)
    ages.frame_heard(20 * S)
    ages.frame_unusable(RejectReason.BAD_FRAME, 20 * S)
    assert names(ages, 22 * S) == ()


def test_the_log_tells_a_change_once_with_meaning_and_mend(caplog: pytest.LogCaptureFixture) -> None:
    told = DegradedLog()
    with caplog.at_level(logging.INFO):
        for tenth in range(100):
            told.tell((Degraded.POSE,) if tenth < 60 else (), tenth * S // 10)
        for tenth in range(100, 200):
            told.tell((Degraded.EKF,) if tenth % 2 else (), tenth * S // 10)
    first, second = caplog.records
    assert first.levelno == logging.WARNING and second.levelno == logging.INFO
    for word in ("pose", Degraded.POSE.meaning, Degraded.POSE.mend):
        assert word in first.getMessage()


def test_a_compass_that_is_bad_is_named() -> None:
    ages = FrameAges()
    ages.frame_heard(0)
    assert degraded_names(0, (), ages, True, (), (), is_compass_bad=True) == (Degraded.COMPASS,)


def test_the_service_tells_what_its_scenery_measured() -> None:
    app = App(Config(zenoh=ZenohConfig(enabled=False)))
    app.pipeline.stage.scenery = FollowedScenery(app.config.camera.camera(), 8)
    assert app.status(S).scenery == SceneryReport(state="autopilot")
    error_rad, sigma_rad = np.radians([0.0, 0.0, 12.0]), np.radians([0.1, 0.1, 0.3])
    app.pipeline.stage.scenery.state = SceneryState("scenery", 1.0, error_rad, sigma_rad, 30, {}, 10.0, 10.0)
    status = app.status(2 * S)
    assert status.scenery is not None
    assert (status.scenery.heading_error_deg, Degraded.COMPASS in status.degraded) == (-12.0, True)
    later = app.status(60 * S)
    assert later.scenery == SceneryReport(state="autopilot")
    assert Degraded.COMPASS not in later.degraded
