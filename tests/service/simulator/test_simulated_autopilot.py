"""The simulated autopilot's bytes, decoded by pymavlink, against the truth and what ArduPilot was seen to do."""

import signal
import socket
import subprocess
import sys
import time
from typing import Any

import msgspec
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.simulator.scenario import ErrorSection, Scenario, load_scenario
from service.simulator.simulated_autopilot import SimulatedAutopilot, main
from tests.support.places import HANG_S

EXACT = ErrorSection(
    heading_bias_deg=0.0, tilt_bias_deg=0.0, attitude_white_deg=0.0, position_sigma_m=0.0, latency_ms=(0.0, 0.0)
)
COMPANION = mavlink.MAVLink(None, 1, 191)


def with_errors(errors: ErrorSection) -> Scenario:
    return msgspec.structs.replace(load_scenario("demo"), errors=errors)


def ask(message_id: int, hz: float) -> bytes:
    message = COMPANION.command_long_encode(
        1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message_id, 1e6 / hz, 0, 0, 0, 0, 0
    )
    return bytes(message.pack(COMPANION))


def timesync(ts1: int) -> bytes:
    return bytes(COMPANION.timesync_encode(0, ts1).pack(COMPANION))


def decoded(frames: list[tuple[float, bytes]]) -> list[tuple[float, Any]]:
    parser = mavlink.MAVLink(None)
    return [(t_s, message) for t_s, frame in frames for message in parser.parse_buffer(frame)]


def flown(scenario: Scenario, until_s: float, *asked: bytes, seed: int = 0) -> list[tuple[float, Any]]:
    autopilot = SimulatedAutopilot(scenario, np.random.default_rng(seed))
    for data in asked:
        autopilot.receive(data, 0.0)
    return decoded(autopilot.due(until_s))


def named(messages: list[tuple[float, Any]], name: str) -> list[tuple[float, Any]]:
    return [item for item in messages if item[1].get_type() == name]


def test_only_heartbeats_and_timesync_before_it_is_asked() -> None:
    messages = flown(load_scenario("demo"), 9.99)
    assert {message.get_type() for _, message in messages} == {"HEARTBEAT", "TIMESYNC"}
    assert len(named(messages, "HEARTBEAT")) == 10
    assert len(named(messages, "TIMESYNC")) == 1
    beat = named(messages, "HEARTBEAT")[0][1]
    assert (beat.type, beat.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


@pytest.mark.parametrize(
    ("name", "hz"),
    [
        ("ATTITUDE", 50.0),
        ("ATTITUDE", 10.0),
        ("GLOBAL_POSITION_INT", 20.0),
        ("GPS_RAW_INT", 2.0),
        ("EKF_STATUS_REPORT", 1.0),
        ("SYSTEM_TIME", 1.0),
        ("HOME_POSITION", 0.5),
    ],
)
def test_asked_rate_is_sent(name: str, hz: float) -> None:
    messages = flown(load_scenario("demo"), 20.0, ask(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"), hz))
    assert 0.95 * 20.0 * hz - 1 <= len(named(messages, name)) <= 1.05 * 20.0 * hz
    ((_, ack),) = named(messages, "COMMAND_ACK")
    assert (ack.command, ack.result) == (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAV_RESULT_ACCEPTED)
    assert (ack.target_system, ack.target_component) == (1, 191)


def test_too_fast_and_unknown_are_denied() -> None:
    messages = flown(load_scenario("demo"), 5.0, ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, 400.0), ask(9999, 1.0))
    assert [ack.result for _, ack in named(messages, "COMMAND_ACK")] == [mavlink.MAV_RESULT_DENIED] * 2
    assert not named(messages, "ATTITUDE")


def test_a_stream_can_be_slowed_and_ended() -> None:
    autopilot = SimulatedAutopilot(load_scenario("demo"), np.random.default_rng(0))
    counts = []
    for start_s, hz in ((0.0, 50.0), (5.0, 5.0), (10.0, -1e6)):
        autopilot.receive(ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, hz), start_s)
        counts.append(len(named(decoded(autopilot.due(start_s + 4.9)), "ATTITUDE")))
    assert 235 <= counts[0] <= 246 and 22 <= counts[1] <= 31 and counts[2] <= 1


def test_without_errors_the_messages_say_the_truth() -> None:
    scenario = with_errors(EXACT)
    ids = ("ATTITUDE", "GLOBAL_POSITION_INT", "GPS_RAW_INT", "EKF_STATUS_REPORT", "SYSTEM_TIME", "HOME_POSITION")
    asked = [ask(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"), 5.0) for name in ids]
    messages = flown(scenario, 10.0, *asked)
    for t_s, attitude in named(messages, "ATTITUDE"):
        truth = scenario.flight.state(t_s)
        np.testing.assert_allclose(
            [attitude.yaw, attitude.pitch, attitude.roll], [truth.yaw_rad, truth.pitch_rad, truth.roll_rad], atol=1e-6
        )
    for t_s, position in named(messages, "GLOBAL_POSITION_INT"):
        truth = scenario.flight.state(t_s)
        place = scenario.frame.enu_from_geodetic(position.lat * 1e-7, position.lon * 1e-7, position.alt * 1e-3)
        np.testing.assert_allclose(place, truth.position_enu_m, atol=0.02)
        velocity = np.array([position.vy, position.vx, -position.vz]) / 100
        np.testing.assert_allclose(velocity, truth.velocity_enu_mps, atol=0.006)
        assert abs(position.time_boot_ms - (t_s + 90.0) * 1e3) < 4.0
    gps = named(messages, "GPS_RAW_INT")[-1][1]
    assert gps.fix_type >= 3
    assert gps.alt_ellipsoid - gps.alt == 47_500
    assert named(messages, "EKF_STATUS_REPORT")[-1][1].flags == 831
    assert named(messages, "HOME_POSITION")[-1][1].altitude == 430_000
    first, last = (named(messages, "SYSTEM_TIME")[index] for index in (0, -1))
    assert last[1].time_unix_usec - first[1].time_unix_usec == round((last[0] - first[0]) * 1e6)


def test_rates_of_the_body_are_those_of_its_attitude() -> None:
    messages = named(flown(with_errors(EXACT), 10.0, ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, 50.0)), "ATTITUDE")
    yaw = np.unwrap([message.yaw for _, message in messages])
    rate = np.array([message.yawspeed for _, message in messages])
    np.testing.assert_allclose(np.gradient(yaw, 0.02)[1:-1], rate[1:-1], atol=3e-3)


def test_timesync_midpoint_finds_the_boot_clock() -> None:
    scenario = with_errors(ErrorSection(latency_ms=(4.0, 18.0)))
    autopilot = SimulatedAutopilot(scenario, np.random.default_rng(3))
    sent_s = {}
    for number in range(300):
        t_s = number * 0.1
        sent_s[number + 1] = t_s
        autopilot.receive(timesync(number + 1), t_s)
    replies = [(t_s, reply) for t_s, reply in named(decoded(autopilot.due(31.0)), "TIMESYNC") if reply.tc1]
    assert len(replies) == 300
    rtt_s = np.array([t_s - sent_s[reply.ts1] for t_s, reply in replies])
    assert rtt_s.min() > 0.008 and rtt_s.max() < 0.039
    errors_s = np.array(
        [reply.tc1 * 1e-9 - autopilot.boot_ns((t_s + sent_s[reply.ts1]) / 2) * 1e-9 for t_s, reply in replies]
    )
    assert abs(errors_s[np.argsort(rtt_s)[:10]].mean()) < 0.003
    assert errors_s.std() > 0.001


def test_link_delays_and_keeps_the_order() -> None:
    scenario = with_errors(ErrorSection(latency_ms=(5.0, 60.0)))
    autopilot = SimulatedAutopilot(scenario, np.random.default_rng(1))
    autopilot.receive(ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, 50.0), 0.0)
    messages = named(decoded(autopilot.due(20.0)), "ATTITUDE")
    arrival_s = np.array([t_s for t_s, _ in messages])
    assert (np.diff(arrival_s) >= 0.0).all()
    delay_s = arrival_s + 90.0 - np.array([message.time_boot_ms for _, message in messages]) * 1e-3
    assert 0.002 < delay_s.min() < 0.010 and 0.050 < delay_s.max() < 0.063


def test_heading_error_has_the_size_that_was_asked() -> None:
    errors = ErrorSection(heading_bias_deg=2.0, attitude_white_deg=0.1)
    scenario = with_errors(errors)
    means_deg, spreads_deg = [], []
    for seed in range(150):
        attitudes = named(flown(scenario, 1.0, ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, 20.0), seed=seed), "ATTITUDE")
        boot = [message.time_boot_ms * 1e-3 / (1 + 20e-6) - 90.0 for _, message in attitudes]
        error = [m.yaw - scenario.flight.state(t).yaw_rad for t, (_, m) in zip(boot, attitudes, strict=True)]
        error_deg = np.degrees((np.array(error) + np.pi) % (2 * np.pi) - np.pi)
        means_deg.append(error_deg.mean())
        spreads_deg.append(error_deg.std())
    assert 1.65 < np.std(means_deg) < 2.35
    assert abs(np.mean(means_deg)) < 0.5
    assert 0.05 < np.mean(spreads_deg) < 0.4


def test_same_seed_same_bytes() -> None:
    def frames(seed: int) -> list[tuple[float, bytes]]:
        autopilot = SimulatedAutopilot(load_scenario("demo"), np.random.default_rng(seed))
        COMPANION.seq = 0
        autopilot.receive(ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, 20.0), 0.0)
        return autopilot.due(3.0)

    assert frames(1) == frames(1)
    assert frames(1) != frames(2)


def test_garbage_is_passed_over() -> None:
    messages = flown(
        load_scenario("demo"), 2.0, b"\xfd\x00garbage\xfe" * 30, ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, 10.0)
    )
    assert len(named(messages, "HEARTBEAT")) == 3


def test_process_answers_on_a_socket_and_ends_on_sigterm() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as service:
        service.bind(("127.0.0.1", 0))
        service.settimeout(HANG_S)
        command = [sys.executable, "-m", "service.simulator.simulated_autopilot", "--scenario", "demo", "--connect"]
        command += [f"127.0.0.1:{service.getsockname()[1]}", "--start-monotonic-ns", str(time.monotonic_ns())]
        with subprocess.Popen(command) as process:
            try:
                _, address = service.recvfrom(65535)
                service.sendto(ask(mavlink.MAVLINK_MSG_ID_ATTITUDE, 50.0), address)
                parser = mavlink.MAVLink(None)
                while not any(m.get_type() == "ATTITUDE" for m in parser.parse_buffer(service.recv(65535)) or []):
                    pass
            finally:
                process.send_signal(signal.SIGTERM)
            assert process.wait(10) == 0


def test_wrong_scenario_is_78(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--scenario", "nowhere", "--connect", "127.0.0.1:1", "--start-monotonic-ns", "0"]) == 78
    assert capsys.readouterr().err.count("\n") == 1
