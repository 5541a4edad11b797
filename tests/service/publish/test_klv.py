"""KLV of fires as readers that are not ours see it, and the socket that sends it."""

import dataclasses
import socket

import numpy as np
import pytest
from stanag4609.st0601 import UASLocalSet, decode_uas_local_set

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_FRD_FROM_CAM, R_cam_from_enu, matrix_from_euler
from distloc.types import FloatArray, TargetState
from service.common.messages import Geodetic, LocatedTarget, VehicleState
from service.config.load import check
from service.config.sections import Config, ConfigError, KlvConfig
from service.publish.klv import KlvSender, NoKlv, fire_packet, make_klv
from tests.support.wire_samples import located, vehicle

CAMERA = Camera(1920, 1080, 1200.0, 1200.0, 959.5, 539.5)
SECOND_NS = 1_000_000_000
R_BODY = matrix_from_euler(np.radians(350.0), np.radians(4.0), np.radians(-25.0))
R_SENSOR_IN_BODY = matrix_from_euler(np.radians(30.0), np.radians(-10.0), np.radians(2.0))


def flying() -> VehicleState:
    state = vehicle()
    pose = dataclasses.replace(state.pose, R_cam_from_enu=R_cam_from_enu(R_BODY, R_SENSOR_IN_BODY))
    return dataclasses.replace(state, pose=pose, R_ned_from_body=R_BODY, image_centre=Geodetic(47.41, 8.58, 402.0))


def read(packet: bytes | None) -> UASLocalSet:
    assert packet is not None
    return decode_uas_local_set(packet)


def with_covariance(covariance_m2: FloatArray) -> LocatedTarget:
    target = located()
    return dataclasses.replace(target, estimate=dataclasses.replace(target.estimate, covariance_enu_m2=covariance_m2))


def test_another_reader_finds_the_fire_and_how_sure_it_is() -> None:
    said = read(fire_packet(located(), flying(), CAMERA, "drone1"))
    assert said.misp_timestamp_microseconds == 1_800_000_000_000_000
    assert (said.value(3), said.value(10), said.value(65)) == ("fire 3", "drone1", 19)
    assert float(said.value(40)) == pytest.approx(47.42774, abs=1e-7)
    assert float(said.value(41)) == pytest.approx(8.60559, abs=1e-7)
    assert float(said.value(42)) == pytest.approx(512.35, abs=0.16)
    assert float(said.value(45)) == pytest.approx(123.54, abs=0.04)  # sigmas 73.5 and 24.5 m: no circle's 2.146
    assert float(said.value(46)) == pytest.approx(16.449, abs=0.04)


def test_it_finds_who_saw_it_from_where_and_where_the_camera_looked() -> None:
    said = read(fire_packet(located(), flying(), CAMERA, "drone1"))
    for tag, value, within in (
        *(
            (13, 47.4, 1e-7),
            (14, 8.55, 1e-7),
            (15, 500.0, 0.16),
            (23, 47.41, 1e-7),
            (24, 8.58, 1e-7),
            (25, 402.0, 0.16),
        ),
        *((5, 350.0, 0.003), (6, 4.0, 4e-4), (7, -25.0, 8e-4), (90, 4.0, 1e-6), (91, -25.0, 1e-6)),
        *((18, 30.0, 1e-6), (19, -10.0, 1e-6), (20, 2.0, 1e-6), (16, 77.32, 0.01), (17, 48.46, 0.01)),
    ):
        assert float(said.value(tag)) == pytest.approx(value, abs=within), tag


def test_what_the_angles_say_is_the_cameras_own_attitude() -> None:
    said = read(fire_packet(located(), flying(), CAMERA, "drone1"))
    platform, sensor = (
        matrix_from_euler(*(np.radians(float(said.value(tag))) for tag in tags)) for tags in ((5, 90, 91), (18, 19, 20))
    )
    R_enu_from_cam = flying().pose.R_cam_from_enu.T
    forward_ned = (platform @ sensor @ R_FRD_FROM_CAM)[:, 2]
    assert np.allclose(forward_ned[[1, 0, 2]] * [1.0, 1.0, -1.0], R_enu_from_cam[:, 2], atol=1e-4)


def test_steep_angles_that_the_short_items_cannot_say_are_in_the_long_ones() -> None:
    steep = dataclasses.replace(flying(), R_ned_from_body=matrix_from_euler(0.0, np.radians(30.0), np.radians(60.0)))
    said = read(fire_packet(located(), steep, CAMERA, "drone1"))
    assert (said.get(6), said.get(7)) == (None, None)
    assert (float(said.value(90)), float(said.value(91))) == (pytest.approx(30.0), pytest.approx(60.0))


def test_without_the_vehicle_the_fire_is_told_alone() -> None:
    said = read(fire_packet(located(), None, CAMERA, "drone1"))
    assert float(said.value(40)) == pytest.approx(47.42774, abs=1e-7)
    assert [said.get(tag) for tag in (5, 13, 16, 18, 23)] == [None] * 5


def test_an_error_that_does_not_fit_is_never_made_smaller() -> None:
    assert fire_packet(with_covariance(np.diag([2600.0**2, 100.0, 100.0])), flying(), CAMERA, "d") is None
    said = read(fire_packet(with_covariance(np.diag([100.0, 100.0, 2600.0**2])), flying(), CAMERA, "d"))
    assert [said.get(tag) for tag in (42, 46)] == [None, None]
    for bad in (located(lat_deg=float("nan")), with_covariance(np.full((3, 3), np.nan))):
        assert fire_packet(bad, flying(), CAMERA, "d") is None
    lost = dataclasses.replace(flying(), time_utc_s=float("nan"))
    assert fire_packet(located(), lost, CAMERA, "d") is None


def test_a_socket_hears_each_fire_once_a_second() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(10.0)
        sender = make_klv(KlvConfig(url=f"udpout:127.0.0.1:{ear.getsockname()[1]}"), CAMERA, "drone1")
        targets = [located(3), located(4, TargetState.COASTING), located(5, TargetState.TENTATIVE)]
        sender.due(targets, None, 0)  # not open yet
        sender.open()
        for tick in range(60):
            sender.due(targets, flying(), tick * SECOND_NS // 20)
        heard = [read(ear.recv(65_536)) for _ in range(6)]
        sender.close()
        sender.close()
    assert [one.value(3) for one in heard] == ["fire 3", "fire 4"] * 3
    assert sender.counters == {"klv_sent": 6, "klv_dropped": 0, "klv_not_said": 0}


def test_what_the_network_does_not_take_is_counted() -> None:
    sender = KlvSender("udpout:255.255.255.255:9", CAMERA, "d")  # broadcast, which nobody allowed
    sender.open()
    sender.due([located()], None, 0)
    sender.due([with_covariance(np.full((3, 3), np.inf))], None, SECOND_NS)
    sender.close()
    assert sender.counters == {"klv_sent": 0, "klv_dropped": 1, "klv_not_said": 1}


def test_nothing_is_sent_unless_told_to() -> None:
    nothing = make_klv(KlvConfig(), CAMERA, "d")
    assert isinstance(nothing, NoKlv)
    nothing.open()
    nothing.due([located()], None, 0)
    nothing.close()
    assert nothing.counters == {}


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("udpout:desk.example:5004", "must be an address"),
        ("tcp:127.0.0.1:5004", "must be udpout"),
        ("udpout:127.0.0.1:0", "0 is no port"),
        ("239.1.2.3:5004", "must start with"),
    ],
)
def test_a_url_that_cannot_be_is_one_line(url: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        check(Config(klv=KlvConfig(url=url)))
    check(Config(klv=KlvConfig(url="udpout:[ff02::1]:5004")))
