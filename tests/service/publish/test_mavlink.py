import dataclasses
import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.camera import Camera
from distloc.types import Ellipse, TargetState
from service.publish.mavlink import MavlinkPublisher
from service.publish.mavlink_messages import confirmed_text
from tests.support.wire_samples import located, vehicle

CAMERA = Camera(1920, 1080, 1200.0, 1200.0, 959.5, 539.5)
SECOND_NS = 10**9


def publisher() -> MavlinkPublisher:
    made = MavlinkPublisher(CAMERA)
    made.set_system(7)
    return made


def decoded(frames: list[bytes]) -> list[Any]:
    return [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in frames]


def one(frames: list[bytes], kind: str, component: int | None = None) -> Any:
    (found,) = [
        message
        for message in decoded(frames)
        if message.get_type() == kind and component in (None, message.get_srcComponent())
    ]
    return found


def command(number: int, component: int, *params: float, system: int = 7, sender: int = 255) -> Any:
    values = [*params, 0, 0, 0, 0, 0, 0, 0][:7]
    encoder = mavlink.MAVLink(None, sender, 190)
    raw = encoder.command_long_encode(system, component, number, 0, *values).pack(encoder)
    return mavlink.MAVLink(None).decode(bytearray(raw))


def test_nothing_is_said_before_the_autopilot_is_known() -> None:
    silent = MavlinkPublisher(CAMERA)
    assert silent.update([located()], 0) == []
    assert silent.due(0, 0, (), vehicle()) == []
    assert silent.adsb([located()], 0) == []
    assert silent.handle(command(512, 100, 259), 0) == []


def test_a_confirmed_target_is_announced_once_and_its_end_too() -> None:
    made = publisher()
    assert made.update([located(state=TargetState.TENTATIVE)], 0) == []
    text = one(made.update([located()], 0), "STATUSTEXT")
    assert (text.text, text.severity) == ("Smoke 3 47.42774N 8.60559E +-180x60m 4.1km", mavlink.MAV_SEVERITY_NOTICE)
    later = decoded(made.update([located()], 10 * SECOND_NS))
    assert "STATUSTEXT" not in [message.get_type() for message in later]
    end = located(state=TargetState.DISMISSED)
    assert one(made.update([end], 11 * SECOND_NS), "STATUSTEXT").text == "Smoke 3 given up"
    assert made.update([end], 12 * SECOND_NS) == []


@given(
    st.integers(0, 2**31),
    st.floats(-90, 90),
    st.floats(-180, 180),
    st.floats(0, allow_infinity=True),
    st.floats(allow_nan=True),
)
def test_the_text_fits(number: int, lat: float, lon: float, semi_major_m: float, range_m: float) -> None:
    text = confirmed_text(located(number, TargetState.CONFIRMED, semi_major_m, lat, lon, range_m))
    assert len(text) <= 50
    assert text.isascii()


def test_the_ellipse_array_and_the_named_values() -> None:
    made = publisher()
    made.due(5 * SECOND_NS, 65_000, (), None)
    frames = made.update([located()], 6 * SECOND_NS)
    array = one(frames, "DEBUG_FLOAT_ARRAY")
    assert (array.name, array.array_id, array.time_usec) == ("FIRE_ELL", 3, 66_000_000)
    assert array.data[2] + array.data[3] == pytest.approx(47.42774, abs=1e-9)
    assert array.data[7:10] == [180.0, 60.0, 90.0]
    assert array.data[:2] == [1.0, 2.0]
    named = {m.name: m.value for m in decoded(frames) if m.get_type() == "NAMED_VALUE_FLOAT"}
    assert named == pytest.approx({"FireSMaj": 180.0, "FireSMin": 60.0, "FireBrg": 90.0, "FireDist": 4100.0})
    assert made.update([located()], 6 * SECOND_NS + 200_000_000) == []


def test_the_geo_status_has_one_sigma_of_the_major_axis() -> None:
    made = publisher()
    other = located(4, TargetState.CONFIRMED, 500.0)
    made.update([other, located(5, TargetState.COASTING, 10.0), located()], 0)
    geo = one(made.due(0, 1, (), None), "CAMERA_TRACKING_GEO_STATUS")
    assert (geo.lat, geo.lon, geo.get_srcComponent(), geo.get_srcSystem()) == (474277400, 86055900, 100, 7)
    assert geo.h_acc == pytest.approx(180.0 / math.sqrt(-2 * math.log(0.05)), rel=1e-4)
    assert geo.v_acc == pytest.approx(10.0, rel=1e-3)
    assert (geo.dist, geo.tracking_status) == (4100.0, 1)
    assert math.isnan(geo.vel_n)


def test_the_target_ahead_lies_in_the_middle_of_the_image() -> None:
    made = publisher()
    made.update([located()], 0)
    image = one(made.due(0, 1, (), vehicle()), "CAMERA_TRACKING_IMAGE_STATUS")
    assert (image.tracking_status, image.tracking_mode) == (1, 1)
    assert (image.point_x, image.point_y) == pytest.approx((0.5, 0.5), abs=1e-6)
    assert image.rec_top_y == pytest.approx(0.5 - 1200 * 40 / 4000 / 1080, abs=1e-6)
    turned = dataclasses.replace(
        vehicle().pose, R_cam_from_enu=np.diag([-1.0, 1.0, -1.0]) @ vehicle().pose.R_cam_from_enu
    )
    away = dataclasses.replace(vehicle(), pose=turned)
    assert one(made.due(SECOND_NS, 1, (), away), "CAMERA_TRACKING_IMAGE_STATUS").tracking_status == 0


def test_the_vehicle_is_asked_for_when_something_tells_of_it() -> None:
    assert not MavlinkPublisher(CAMERA).needs_vehicle(0)  # it is silent
    made = publisher()
    times_ns = range(0, 10 * SECOND_NS, SECOND_NS // 20)
    asked = [now_ns for now_ns in times_ns if made.needs_vehicle(now_ns) and made.due(now_ns, 1, (), vehicle())]
    assert {later - earlier for earlier, later in itertools.pairwise(asked)} == {SECOND_NS * 19 // 20}
    stop = command(511, 100, mavlink.MAVLINK_MSG_ID_CAMERA_FOV_STATUS, -1)
    often = command(511, 100, mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS, 50_000)
    assert made.handle(stop, 0) and made.handle(often, 0)
    later_ns = [10 * SECOND_NS + now_ns for now_ns in times_ns]
    assert all(made.needs_vehicle(now_ns) and made.due(now_ns, 1, (), vehicle()) for now_ns in later_ns)


def test_the_field_of_view() -> None:
    fov = one(publisher().due(0, 1, (), vehicle()), "CAMERA_FOV_STATUS")
    assert fov.hfov == pytest.approx(math.degrees(2 * math.atan(960 / 1200)), abs=1e-4)
    assert fov.vfov == pytest.approx(math.degrees(2 * math.atan(540 / 1200)), abs=1e-4)
    assert fov.q == pytest.approx([math.sqrt(0.5), 0, 0, math.sqrt(0.5)], abs=1e-6)  # yaw 90 degrees: east
    assert (fov.lat_camera, fov.alt_camera, fov.lat_image) == (474000000, 500000, -(2**31))


def test_one_beat_a_second_from_each_component_with_its_own_counter() -> None:
    made = publisher()
    frames = [frame for tick in range(100) for frame in made.due(tick * SECOND_NS // 10, tick * 100, (), None)]
    for component in (191, 100):
        messages = [message for message in decoded(frames) if message.get_srcComponent() == component]
        assert sum(message.get_type() == "HEARTBEAT" for message in messages) == 10
        assert [message.get_seq() for message in messages] == list(range(len(messages)))
    beat = one(made.due(20 * SECOND_NS, 0, ("link",), None), "HEARTBEAT", 191)
    assert (beat.type, beat.autopilot, beat.system_status) == (18, 8, mavlink.MAV_STATE_CRITICAL)


def test_a_request_is_acknowledged_and_answered() -> None:
    answer = publisher().handle(command(512, 100, 259), 0)
    ack, information = decoded(answer)
    assert (ack.command, ack.result, ack.target_system, ack.target_component) == (512, 0, 255, 190)
    assert (information.get_type(), information.resolution_h) == ("CAMERA_INFORMATION", 1920)
    assert one(publisher().handle(command(512, 100, 276), 0), "COMMAND_ACK").result == 1


def test_an_interval_is_honoured_and_a_stop_too() -> None:
    made = publisher()
    assert one(made.handle(command(511, 0, 275, 200_000), 0), "COMMAND_ACK").result == 0
    frames = [frame for tick in range(20) for frame in made.due(tick * SECOND_NS // 10, 0, (), None)]
    assert sum(m.get_type() == "CAMERA_TRACKING_IMAGE_STATUS" for m in decoded(frames)) == 10
    assert one(made.handle(command(511, 100, 275, -1), 0), "COMMAND_ACK").result == 0
    frames = made.due(9 * SECOND_NS, 0, (), None)
    assert {message.get_type() for message in decoded(frames)} == {"HEARTBEAT"}
    for interval_us in (-1, 10, math.nan, math.inf):
        result = one(made.handle(command(511, 191, 0, interval_us), 0), "COMMAND_ACK").result
        assert result == mavlink.MAV_RESULT_DENIED


@pytest.mark.parametrize(("component", "results"), [(191, [3]), (100, [3]), (0, []), (1, [])])
def test_other_commands(component: int, results: list[int]) -> None:
    frames = publisher().handle(command(400, component, 1), 0)
    assert [message.result for message in decoded(frames)] == results
    assert publisher().handle(command(400, component, 1, system=8), 0) == []


def results(frames: list[bytes]) -> list[int]:
    return [message.result for message in decoded(frames) if message.get_type() == "COMMAND_ACK"]


@pytest.mark.parametrize("ask", [(521, 1), (512, 259)])
def test_the_exchange_that_qgroundcontrol_makes(ask: tuple[int, int]) -> None:
    """It hears the camera's heartbeat, asks what it is and has, draws the box, and lets the pilot pick and stop."""
    made = publisher()
    made.update([located()], 0)
    beat = one(made.due(0, 1, (), vehicle()), "HEARTBEAT", 100)
    assert beat.type == mavlink.MAV_TYPE_CAMERA
    answer = made.handle(command(ask[0], 100, ask[1]), 0)
    assert results(answer) == [mavlink.MAV_RESULT_ACCEPTED]
    information = one(answer, "CAMERA_INFORMATION", 100)
    assert information.flags & mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT
    for number, parameter in ((522, 1), (525, 0), (527, 1), (2504, 0), (2505, 0), (512, 260), (512, 269)):
        assert results(made.handle(command(number, 100, parameter), 0)) == [mavlink.MAV_RESULT_UNSUPPORTED]
    assert results(made.handle(command(2004, 100, 0.5, 0.5, 0.02), 0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert results(made.handle(command(511, 100, 275, 500_000), 0)) == [mavlink.MAV_RESULT_ACCEPTED]
    drawn = one(made.due(SECOND_NS, 1, (), vehicle()), "CAMERA_TRACKING_IMAGE_STATUS")
    assert (drawn.tracking_status, drawn.point_x) == (mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE, pytest.approx(0.5))
    assert results(made.handle(command(2010, 100), 0)) == [mavlink.MAV_RESULT_ACCEPTED]
    gone = decoded(made.due(9 * SECOND_NS, 1, (), vehicle()))
    assert "CAMERA_TRACKING_IMAGE_STATUS" not in [message.get_type() for message in gone]
    assert results(made.handle(command(2004, 100, 0.5, 0.5, 0.02), 0)) == [mavlink.MAV_RESULT_ACCEPTED]
    one(made.due(12 * SECOND_NS, 1, (), vehicle()), "CAMERA_TRACKING_IMAGE_STATUS")


def test_what_is_not_tracked_cannot_be_chosen() -> None:
    made = publisher()
    assert results(made.handle(command(2004, 100, 0.5, 0.5), 0)) == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    made.update([located()], 0)
    made.see_vehicle(vehicle())
    assert results(made.handle(command(2004, 100, 0.1, 0.5), 0)) == [mavlink.MAV_RESULT_DENIED]
    assert results(made.handle(command(2004, 100, math.nan, 0.5), 0)) == [mavlink.MAV_RESULT_DENIED]
    assert results(made.handle(command(2005, 100, 0.4, 0.4, 0.6, 0.6), 0)) == [mavlink.MAV_RESULT_UNSUPPORTED]
    assert results(made.handle(command(2004, 191, 0.5, 0.5), 0)) == [mavlink.MAV_RESULT_UNSUPPORTED]
    assert results(made.handle(command(521, 100, 0), 0)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert made.handle(command(2010, 0), 0) != [] and made.handle(command(400, 0), 0) == []


def test_a_stranger_s_command_is_denied_and_told_of_once() -> None:
    made = publisher()
    for sender in (245, 245, 7, 245):
        assert results(made.handle(command(512, 100, 259, sender=sender), 0)) == [mavlink.MAV_RESULT_DENIED]
    assert made.newly_refused() == [245, 7]
    assert made.newly_refused() == [] and made.refused_systems == {7, 245}
    assert made.handle(command(512, 0, 259, sender=245), 0) == []  # to all of the system: the autopilot answers
    assert made.commands == {"taken": 0, "refused": 5}


def test_adsb_at_one_hertz() -> None:
    made = publisher()
    frames = [frame for tick in range(20) for frame in made.adsb([located()], tick * SECOND_NS // 10)]
    assert len(frames) == 2
    pin = one(frames[:1], "ADSB_VEHICLE")
    assert (pin.lat, pin.altitude, pin.emitter_type, pin.callsign) == (474277400, 512346, 19, "SMK3")


def test_impossible_numbers_are_clamped() -> None:
    made = publisher()
    worst = located(2**40, lat_deg=1e9, lon_deg=-1e300, range_m=math.nan)
    estimate = dataclasses.replace(worst.estimate, vertical95_m=1e300, observations=10**30, bearing_rad=math.inf)
    estimate = dataclasses.replace(estimate, ellipse95=Ellipse(1e300, 1e300, math.nan))
    worst = dataclasses.replace(worst, estimate=estimate, last_seen_utc_s=-math.inf)
    frames = made.update([worst], 0) + made.due(0, 2**50, (), vehicle()) + made.adsb([worst], 0)
    geo = one(frames, "CAMERA_TRACKING_GEO_STATUS")
    assert (geo.lat, geo.lon) == (2**31 - 1, -(2**31))
    unplaced = located(9, lat_deg=math.nan)
    assert made.update([unplaced], 5 * SECOND_NS) == []


def test_memory_is_bounded() -> None:
    made = publisher()
    for number in range(1000):
        made.update([located(number)], number)
    assert len(made._announcer._said) == len(made._ellipse_sent_ns) == 64
