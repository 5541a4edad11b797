"""The sizes of the poses' errors: the config's grades, and each rule that widens them, on both its sides."""

import math
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import CameraPose, PoseErrors
from service.autopilot.autopilot import Autopilot
from service.autopilot.pose_quality import PoseQuality
from service.autopilot.timesync import Timesync
from service.config.load import load_config
from service.config.sections import ConfigError, MavlinkConfig, MountConfig, PoseErrorsConfig
from service.mavlink.framer import Framer, decode

BASE = PoseErrors(0.03, 0.01, 0.002, 1.0, 600.0)
S = 1_000_000_000
NAN = float("nan")
UNKNOWN_U32 = 4_294_967_295


def over_the_wire(message: Any) -> Any:
    (frame,) = Framer().feed(bytes(message.pack(mavlink.MAVLink(None, 1, 1))))
    return decode(frame)


def ekf(compass: float = 0.02, velocity: float = 0.04, position: float = 0.01) -> Any:
    return over_the_wire(mavlink.MAVLink_ekf_status_report_message(831, velocity, position, 0.01, compass, 0.0, 0.0))


def estimator(mag: float = 0.1, vel: float = 0.1, pos: float = 0.1, accuracy_m: float = 0.4) -> Any:
    ratios = (vel, pos, 0.1, mag, 0.0, 0.0)
    return over_the_wire(mavlink.MAVLink_estimator_status_message(0, 831, *ratios, accuracy_m, 0.5))


def gps(fix: int = 3, eph: int = 90, h_acc: int = 0, hdg_acc: int = 0, yaw: int = 0) -> Any:
    place = (400_000_000, 30_000_000, 100_000)
    return over_the_wire(
        mavlink.MAVLink_gps_raw_int_message(0, fix, *place, eph, 150, 0, 0, 12, 147_000, h_acc, 900, 20, hdg_acc, yaw)
    )


def quality_after(*messages: Any, base: PoseErrors = BASE, at_ns: int = S) -> PoseQuality:
    quality = PoseQuality(base)
    for message in messages:
        take = {
            "EKF_STATUS_REPORT": quality.ekf_status,
            "ESTIMATOR_STATUS": quality.estimator_status,
            "GPS_RAW_INT": quality.gps,
        }[message.get_type()]
        take(message, at_ns)
    return quality


def but_drift(errors: PoseErrors) -> PoseErrors:
    """Without what a receiver states of its place: that may be less than the base's."""
    return replace(errors, position_bias_m=BASE.position_bias_m)


def errors_after(*messages: Any, base: PoseErrors = BASE) -> PoseErrors:
    return quality_after(*messages, base=base).errors(0.0, 0.0, S)


def test_silence_and_good_words_widen_nothing() -> None:
    assert errors_after() == BASE
    assert errors_after(ekf(0.5, 0.5, 0.5), estimator(0.5, 0.5, 0.5, 1.0), gps(h_acc=1000)) == replace(
        BASE, position_bias_m=1.0
    )


@pytest.mark.parametrize(
    ("message", "heading", "tilt", "position_m"),
    [
        (ekf(compass=1.0), 2.0, 1.0, 1.0),
        (ekf(compass=0.75), 1.5, 1.0, 1.0),
        (ekf(compass=100.0), 10.0, 1.0, 1.0),
        (ekf(velocity=1.0), 1.0, 2.0, 2.0),
        (ekf(position=0.8), 1.0, 1.6, 2.0),  # 0.8 of 5 sigma of 0.5 m
        (ekf(position=10.06), 1.0, 10.0, 25.0),  # the 60 m glitch of copter_faults
        (estimator(mag=1.0), 2.0, 1.0, 1.0),
        (estimator(vel=1.5), 1.0, 3.0, 3.0),
        (estimator(pos=1.0), 1.0, 2.0, 2.5),
        (estimator(accuracy_m=7.0), 1.0, 1.0, 7.0),
        (estimator(accuracy_m=1e9), 1.0, 1.0, 100.0),
    ],
)
def test_a_poor_estimate_widens(message: Any, heading: float, tilt: float, position_m: float) -> None:
    errors = errors_after(message)
    assert errors.heading_bias_rad == pytest.approx(0.03 * heading)
    assert errors.tilt_bias_rad == pytest.approx(0.01 * tilt)
    assert errors.position_m == pytest.approx(position_m)
    assert (errors.attitude_white_rad, errors.bias_time_constant_s) == (0.002, 600.0)


@pytest.mark.parametrize(
    ("message", "position_m"),
    [
        (gps(h_acc=14), 0.05),
        (gps(h_acc=2600), 2.6),
        (gps(fix=6, h_acc=20), 0.05),
        (gps(fix=6), 0.05),
        (gps(fix=5), 0.3),
        (gps(fix=4, eph=70), 0.7),
        (gps(fix=3, eph=250), 2.5),
        (gps(fix=3, eph=65535), 1.0),
        (gps(fix=3, eph=9999), 1.0),
        (gps(fix=3, h_acc=UNKNOWN_U32), 0.9),
        (gps(fix=1, h_acc=800), 10.0),
        (gps(fix=0, eph=65535), 0.05),
    ],
)
def test_position_by_the_receivers_accuracy_fix_and_hdop(message: Any, position_m: float) -> None:
    survey = PoseErrorsConfig(grade="survey").pose_errors()
    assert errors_after(message, base=survey).position_m == pytest.approx(position_m)


@pytest.mark.parametrize(
    ("hdg_acc", "yaw", "heading_deg"),
    [
        (18_000_000, 0, 0.3),  # hovering without a yaw of its own: the course is unknown, the heading is not
        (20_000, 9000, 0.3),
        (150_000, 9000, 1.5),
        (9_000_000, 9000, 30.0),
        (UNKNOWN_U32, 9000, 0.3),
        (0, 65535, 2.0),  # a dual antenna that lost its yaw
    ],
)
def test_heading_by_a_receiver_that_gives_yaw(hdg_acc: int, yaw: int, heading_deg: float) -> None:
    survey = PoseErrorsConfig(grade="survey").pose_errors()
    errors = errors_after(gps(h_acc=20, hdg_acc=hdg_acc, yaw=yaw), base=survey)
    assert math.degrees(errors.heading_bias_rad) == pytest.approx(heading_deg)


def test_attitude_by_turn_rate_times_clock() -> None:
    quality = PoseQuality(BASE)
    assert quality.errors(0.2, 0.0, S) == quality.errors(0.0, 0.05, S) == BASE
    assert quality.errors(0.1, 0.015, S).attitude_white_rad == pytest.approx(0.0025)  # 3-4-5
    for bad in (NAN, -1.0, math.inf):
        assert quality.errors(bad, 0.01, S) == quality.errors(0.1, bad, S) == BASE


def test_old_words_are_forgotten_and_new_ones_replace_them() -> None:
    quality = quality_after(ekf(1.0, 1.0, 1.0), estimator(1.0, 1.0, 1.0, 9.0), gps(h_acc=5000, hdg_acc=500_000, yaw=1))
    assert quality.errors(0.0, 0.0, 11 * S) == quality.errors(0.0, 0.0, S) != BASE
    assert quality.errors(0.0, 0.0, 11 * S + 1) == BASE
    quality = quality_after(ekf(1.0, 1.0, 1.0))
    quality.ekf_status(ekf(), 2 * S)
    assert quality.errors(0.0, 0.0, 2 * S) == BASE


def test_the_worst_of_two_sources_counts() -> None:
    assert errors_after(ekf(compass=1.0), estimator(mag=0.1)).heading_bias_rad == pytest.approx(0.06)
    assert errors_after(estimator(accuracy_m=3.0), gps(h_acc=1500)).position_m == pytest.approx(3.0)


@pytest.mark.parametrize("bad", [NAN, -1.0, math.inf])
def test_bad_values_are_ignored(bad: float) -> None:
    poor = (ekf(1.0, 1.0, 1.0), estimator(accuracy_m=4.0))
    assert errors_after(ekf(bad, bad, bad), estimator(bad, bad, bad, bad)) == BASE
    assert errors_after(*poor, ekf(bad, bad, bad), estimator(bad, bad, bad, bad)) == errors_after(*poor)


anything = st.floats(allow_nan=True, allow_infinity=True, width=32)


@given(st.tuples(anything, anything, anything), st.tuples(anything, anything, anything, anything), anything, anything)
def test_never_below_the_base_and_always_finite(
    ratios: tuple[float, ...], states: tuple[float, ...], turn_rate_rps: float, spread_s: float
) -> None:
    errors = quality_after(ekf(*ratios), estimator(*states)).errors(turn_rate_rps, spread_s, S)
    assert all(got >= least for got, least in zip(astuple(but_drift(errors)), astuple(BASE), strict=True))
    limits = (0.3, 0.1, math.inf, 100.0, 600.0, math.inf, 100.0, 0.0, 1.0)
    assert all(got <= most * (1 + 1e-12) for got, most in zip(astuple(errors), limits, strict=True))


def test_the_grades_and_their_overrides(tmp_path: Path) -> None:
    consumer, survey = PoseErrorsConfig().pose_errors(), PoseErrorsConfig(grade="survey").pose_errors()
    assert astuple(consumer) == pytest.approx(
        [0.0349066, 0.00872665, 0.00174533, 1.0, 120.0, 2.00713, 1.5, 0.0, 1.0], rel=1e-5
    )
    assert astuple(survey) == pytest.approx(
        [0.00523599, 0.00174533, 0.000872665, 0.05, 120.0, 2.00713, 0.1, 0.0, 1.0], rel=1e-5
    )
    path = tmp_path / "config.toml"
    path.write_text('[pose_errors]\ngrade = "survey"\nheading_bias_deg = 1\nposition_m = 0.2')
    errors = load_config(path).pose_errors.pose_errors()
    assert (errors.heading_bias_rad, errors.position_m) == pytest.approx((math.pi / 180, 0.2))
    assert errors.tilt_bias_rad == survey.tilt_bias_rad


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("grade = 'rtk'", "pose_errors.grade is 'rtk'"),
        ("heading_bias_deg = 0", "pose_errors.heading_bias_deg is 0: expected `float` > 0.0"),
        ("position_m = inf", "pose_errors.position_m is inf: expected `float` <= 1000.0"),
        ("tilt_bias_deg = nan", "pose_errors.tilt_bias_deg is nan"),
        ("position = 3", "it may have grade, heading_bias_deg"),
    ],
)
def test_a_wrong_section_is_a_config_error(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(f"[pose_errors]\n{text}")
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert says in str(caught.value)


def test_spread_of_the_clock() -> None:
    timesync = Timesync()
    timesync.observe_boot(1 * S, 2 * S)
    assert timesync.spread_s == 0.05  # the envelope only
    for step, slip_ns in enumerate((0, 4_000_000, 2_000_000)):
        now_ns = (10 + step) * S
        ts1 = timesync.request(now_ns)
        assert timesync.reply(ts1, now_ns + 500_000 - S - slip_ns, now_ns + 1_000_000)
    assert timesync.spread_s == pytest.approx(0.002)
    timesync.observe_boot(50 * S, 51 * S)  # no reply for over 30 s
    assert timesync.spread_s == 0.05


class Stream:
    """An Autopilot that hears one system at 20 Hz, with the host's clock `offset_ms` ahead of the time since boot."""

    def __init__(self, **options: Any) -> None:
        self.offset_ms = 0
        self.autopilot = Autopilot(MavlinkConfig(), MountConfig(), **options)
        self.send(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3), 1000)
        self.send(gps(h_acc=800), 1000)

    def send(self, message: Any, boot_ms: int) -> None:
        (frame,) = Framer().feed(bytes(message.pack(mavlink.MAVLink(None, 1, 1))))
        self.autopilot.receive(frame, (boot_ms + self.offset_ms) * 1_000_000)

    def fly(self, start_ms: int, yaw_rate_rps: float = 0.0) -> PoseErrors:
        """The errors of a pose half a second into a second of flight."""
        for boot_ms in range(start_ms, start_ms + 1001, 50):
            yaw_rad = yaw_rate_rps * (boot_ms - start_ms) * 1e-3
            self.send(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, yaw_rad, 0, 0, yaw_rate_rps), boot_ms)
            place = (400_000_000, 30_000_000, 100_000, 50_000)
            self.send(mavlink.MAVLink_global_position_int_message(boot_ms, *place, 0, 0, 0, 0), boot_ms)
        host_ms = start_ms + self.offset_ms
        pose = self.autopilot.camera_pose((host_ms + 500) * 1_000_000, (host_ms + 1000) * 1_000_000)
        assert isinstance(pose, CameraPose) and pose.errors is not None
        return pose.errors


def test_poses_carry_the_errors_of_their_time() -> None:
    stream = Stream(pose_errors=BASE)
    assert but_drift(stream.fly(1000)) == BASE and stream.fly(1000).position_bias_m == 0.8
    stream.send(mavlink.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, 0.9, 0, 0), 2100)
    stream.send(mavlink.MAVLink_estimator_status_message(0, 831, 0.1, 0.1, 0.1, 0.1, 0, 0, 3.0, 3.0), 2100)
    widened = stream.fly(2100)
    assert widened.heading_bias_rad == pytest.approx(0.03 * 1.8) and widened.position_m == 3.0
    turning = stream.fly(3200, yaw_rate_rps=0.1)  # no TIMESYNC: the envelope's 50 ms
    assert turning.attitude_white_rad == pytest.approx(math.hypot(0.002, 0.1 * 0.05), rel=1e-3)
    assert but_drift(stream.fly(13_000)) == BASE


def test_poses_of_an_autopilot_without_a_config_are_of_the_consumer_grade() -> None:
    assert but_drift(Stream().fly(1000)) == PoseErrorsConfig().pose_errors()


def test_a_reboot_forgets_what_was_said() -> None:
    stream = Stream(pose_errors=BASE)
    stream.fly(100_000)
    stream.send(mavlink.MAVLink_ekf_status_report_message(831, 0.1, 0.1, 0.1, 0.9, 0, 0), 101_100)
    assert stream.fly(101_100) != BASE
    assert stream.fly(102_200) != BASE
    stream.offset_ms = 101_300  # the boot time starts anew at 2 s while the host's clock goes on
    for boot_ms in range(2000, 3000, 50):
        stream.send(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0), boot_ms)
    stream.send(gps(h_acc=800), 3000)
    assert stream.autopilot.epoch == 1 and but_drift(stream.fly(3000)) == BASE
