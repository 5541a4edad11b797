"""The same autopilot by two paths: late copies, whole and in part, a reboot seen through both, the wrap."""

import itertools
import random
from collections.abc import Iterator
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import CameraPose
from service.autopilot.autopilot import Autopilot
from service.autopilot.boot_clock import BootClock
from service.autopilot.intake.sequences import SequenceLosses
from service.config.sections import MavlinkConfig, MountConfig
from service.mavlink.framer import Framer

MS = 1_000_000
HOST_NS = 7_000_000_000_000
UNIX_US = 1_780_000_000_000_000
STEP_MS = 50

Arrival = tuple[int, bytes]  # when, in ms of the host, and the frame


def flight(start_ms: int, count: int, host_ms: int, first_sequence: int = 0) -> Iterator[Arrival]:
    """A frame of each kind that we hear, in the order in which they are sent; `start_ms` is since boot."""
    mav = mavlink.MAVLink(None, 1, 1)
    mav.seq = first_sequence
    for step in range(count):
        boot_ms = (start_ms + step * STEP_MS) % 2**32
        place = (400_000_000, 30_000_000, 100_000, 50_000)
        messages: list[Any] = []
        if step % 20 == 0:
            unix_us = UNIX_US + (host_ms + step * STEP_MS) * 1000
            messages += [
                mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3),
                mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 100_000, 0, 0, 0, 0, 9, 147_000),
                mavlink.MAVLink_system_time_message(unix_us, boot_ms),
            ]
        messages += [
            mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_global_position_int_message(boot_ms, *place, 0, 0, 0, 0),
        ]
        for message in messages:
            yield host_ms + step * STEP_MS, bytes(message.pack(mav))
            mav.seq = (mav.seq + 1) % 256


def late(arrivals: list[Arrival], by_ms: int, batch_ms: int = 1) -> list[Arrival]:
    """The same by a path that is slower; with `batch_ms` it brings all of such a span at once, at its end."""
    ends_ms = [(at_ms // batch_ms + 1) * batch_ms - 1 for at_ms, _ in arrivals]
    return [(end_ms + by_ms, raw) for end_ms, (_, raw) in zip(ends_ms, arrivals, strict=True)]


def heard(*paths: list[Arrival]) -> Autopilot:
    autopilot, framer = Autopilot(MavlinkConfig(), MountConfig()), Framer()
    for at_ms, raw in sorted(itertools.chain(*paths), key=lambda arrival: arrival[0]):
        for frame in framer.feed(raw):
            autopilot.receive(frame, at_ms * MS + HOST_NS)
    return autopilot


def has_pose(autopilot: Autopilot, host_ms: int) -> bool:
    at_ns = host_ms * MS + HOST_NS
    return isinstance(autopilot.camera_pose(at_ns, at_ns + 300 * MS), CameraPose)


@pytest.mark.parametrize("batch_ms", [1, 500, 3_000])
@pytest.mark.parametrize("by_ms", [300, 1_500, 8_000])
@pytest.mark.parametrize("start_ms", [20_000, 2**32 - 9_000])
def test_late_copies_are_no_reboot_and_no_losses(by_ms: int, batch_ms: int, start_ms: int) -> None:
    first = list(flight(start_ms, 400, 0))
    autopilot = heard(first, late(first, by_ms, batch_ms))
    assert autopilot.epoch == 0 and has_pose(autopilot, 19_000)
    assert autopilot.counters()["lost"] == {"1/1": 0}
    assert autopilot.messages["ATTITUDE"] == 400 and autopilot.ignored["copy"] >= 850


@pytest.mark.parametrize("by_ms", [300, 1_500, 8_000])
def test_what_the_first_path_lost_is_taken_from_the_second_and_is_no_reboot(by_ms: int) -> None:
    whole, rng = list(flight(20_000, 400, 0)), random.Random(by_ms)
    first = [one for one in whole if rng.random() > 0.1]
    autopilot = heard(first, late(whole, by_ms, 1_000))
    assert autopilot.epoch == 0 and has_pose(autopilot, 8_000)
    missing = len(whole) - len(first)
    assert int(autopilot.counters()["lost"]["1/1"]) <= 1.2 * missing  # type: ignore[index]


@pytest.mark.parametrize("by_ms", [300, 2_000, 8_000])
def test_messages_sent_apart_on_a_slower_link_are_no_reboot(by_ms: int) -> None:
    """Two ports of one autopilot: other times, other sequence numbers, nothing is byte for byte the same."""
    autopilot = heard(list(flight(20_000, 400, 0)), late(list(flight(20_025, 400, 25, 77)), by_ms, 2_000))
    assert autopilot.epoch == 0 and has_pose(autopilot, 19_000)


def test_the_slow_path_is_the_only_one_for_a_while() -> None:
    whole = list(flight(100_000, 800, 0))
    first = [one for one in whole if not 10_000 <= one[0] < 25_000]
    autopilot = heard(first, late(whole, 5_000))
    assert autopilot.epoch == 0 and has_pose(autopilot, 39_000)
    assert autopilot.messages["ATTITUDE"] == 800


@pytest.mark.parametrize("is_same", [True, False])
@pytest.mark.parametrize(("uptime_ms", "by_ms"), [(100_000, 2_000), (100_000, 8_000), (40_000, 8_000)])
def test_a_reboot_seen_through_two_paths_is_one(uptime_ms: int, by_ms: int, is_same: bool) -> None:
    before, after = list(flight(uptime_ms, 200, 0)), list(flight(2_000, 600, 12_000, 40))
    second = before if is_same else list(flight(uptime_ms + 20, 200, 20, 99))
    autopilot = heard(before, after, late(second + after, by_ms, 500))
    assert autopilot.epoch == 1 and has_pose(autopilot, 40_000)
    time_utc_s, source = autopilot.utc_s(40_000 * MS + HOST_NS)
    assert source == "gps" and time_utc_s == pytest.approx(UNIX_US * 1e-6 + 40.0, abs=0.1)


def test_a_system_time_sent_late_by_the_same_boot_ends_the_doubt() -> None:
    autopilot = heard(list(flight(100_000, 100, 0)))
    mav, framer = mavlink.MAVLink(None, 1, 1), Framer()
    for boot_ms in range(50_000, 52_000, 100):
        for message in (
            mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_system_time_message(UNIX_US + (boot_ms - 100_000) * 1000, boot_ms),
        ):
            (frame,) = framer.feed(bytes(message.pack(mav)))
            autopilot.receive(frame, 5_000 * MS + (boot_ms - 50_000) * MS + HOST_NS)
    assert autopilot.epoch == 0


def test_times_that_do_not_agree_with_each_other_are_no_reboot() -> None:
    clock, rng = BootClock(), random.Random(1)
    clock.update(500_000, 0)
    odd = [clock.update(rng.randrange(0, 400_000), step * MS) for step in range(1, 30)]
    assert odd == [None] * 29 and not clock.take_reboot()


def test_requests_of_ours_that_a_router_sends_back_are_taken_once() -> None:
    autopilot, framer = Autopilot(MavlinkConfig(), MountConfig(), replay=True), Framer()
    mav = mavlink.MAVLink(None, 1, 191)
    (request,) = framer.feed(bytes(mavlink.MAVLink_timesync_message(0, 1_000).pack(mav)))
    autopilot.receive(request, 1_000 * MS)
    autopilot.receive(request, 1_900 * MS)
    assert autopilot.timesync.reply(1_000, 5 * MS, 2_000 * MS) and autopilot.timesync.rtt_ns == 1_000 * MS


def test_losses_of_each_path_are_not_counted_twice() -> None:
    losses = SequenceLosses()
    losses.heard(1, 1, 0)
    for number in range(1, 600):
        if number % 10:
            losses.heard(1, 1, number % 256)
        if number > 100:  # the second path lost others, and has what the first lost
            is_copy = (number - 100) % 10 != 0
            losses.heard(1, 1, (number - 100) % 256, is_copy=is_copy)
    assert losses.lost == {(1, 1): 59}
