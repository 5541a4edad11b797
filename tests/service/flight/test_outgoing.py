"""What is told of the vehicle goes by the attitude that is used."""

import socket
from collections import deque

import msgspec
import numpy as np
import pytest
from stanag4609.st0601 import decode_uas_local_set

from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from service.config.load import load_config
from service.config.sections import KlvConfig
from service.flight.outgoing import Outgoing
from service.localise.scenery import NoScenery, SceneryState
from service.mavlink.links import MavlinkLinks
from service.publish.exchange.tak.switch import NullTak
from service.publish.zenoh import NullPublisher
from service.recordings.posed_frames import PosedFrames
from service.recordings.recorder import NullRecorder
from service.recordings.recording import Recording
from tests.support.places import CUT, HANG_S
from tests.support.wire_samples import located


def test_the_footprint_turns_with_the_corrected_attitude_and_the_heading_stays_the_autopilots() -> None:
    config = load_config(CUT / "config.toml")
    posed = PosedFrames(Recording(CUT), config)
    deque(posed.pairs(lambda stamp_ns: None), maxlen=0)
    links = MavlinkLinks(config.mavlink, NullRecorder(), lambda link, frame, now_ns: None)
    outgoing = Outgoing(config, posed.autopilot, links, NullPublisher(), NullTak())
    measured = SceneryState("scenery", 0.0, np.radians([0.0, 0.0, -20.0]), np.radians([0.1, 0.1, 0.2]))
    seen = []
    for scenery in (NoScenery.state, measured):
        outgoing.due(posed.stamp_ns, (), scenery)
        vehicle = outgoing._vehicle_state(posed.stamp_ns)
        assert vehicle is not None
        look_enu = vehicle.pose.R_cam_from_enu[2]
        seen.append((np.degrees(np.arctan2(look_enu[0], look_enu[1])), vehicle))
    turned_deg = (seen[1][0] - seen[0][0] + 180.0) % 360.0 - 180.0
    assert turned_deg == pytest.approx(-20.0, abs=0.5)  # the compass read 20 too much
    assert seen[0][1].heading_deg == seen[1][1].heading_deg
    assert seen[0][1].footprint != seen[1][1].footprint


def test_klv_of_a_flight_has_the_attitudes_that_its_camera_had() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear:
        ear.bind(("127.0.0.1", 0))
        ear.settimeout(HANG_S)
        klv = KlvConfig(url=f"udpout:127.0.0.1:{ear.getsockname()[1]}")
        config = msgspec.structs.replace(load_config(CUT / "config.toml"), klv=klv)
        posed = PosedFrames(Recording(CUT), config)
        deque(posed.pairs(lambda stamp_ns: None), maxlen=0)
        links = MavlinkLinks(config.mavlink, NullRecorder(), lambda link, frame, now_ns: None)
        outgoing = Outgoing(config, posed.autopilot, links, NullPublisher(), NullTak())
        outgoing.klv.open()
        outgoing._located, outgoing._located_ns = [located()], posed.stamp_ns
        outgoing.due(posed.stamp_ns, (), NoScenery.state)
        said = decode_uas_local_set(ear.recv(65_536))
        for later_s in range(1, 60):  # the camera is dead: nothing is told as of now
            outgoing.due(posed.stamp_ns + later_s * 1_000_000_000, (), NoScenery.state)
        assert outgoing.klv.counters["klv_sent"] == 10
        outgoing.klv.close()
    vehicle = outgoing._vehicle_state(posed.stamp_ns)
    assert vehicle is not None and vehicle.R_ned_from_body is not None
    mount = config.camera.mount.R_body_from_mount
    assert np.allclose(vehicle.pose.R_cam_from_enu, R_cam_from_enu(vehicle.R_ned_from_body, mount), atol=1e-9)
    platform, sensor = (
        matrix_from_euler(*(np.radians(float(said.value(tag))) for tag in tags)) for tags in ((5, 90, 91), (18, 19, 20))
    )
    assert np.allclose(platform, vehicle.R_ned_from_body, atol=1e-4)
    assert np.allclose(sensor, mount, atol=1e-6)
    assert float(said.value(13)) == pytest.approx(vehicle.place.lat_deg, abs=1e-7)
    assert (said.value(3), said.value(10)) == ("fire 3", config.vehicle)
