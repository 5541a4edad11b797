"""What is told of the vehicle goes by the attitude that is used."""

from collections import deque

import numpy as np
import pytest

from service.config.load import load_config
from service.flight.outgoing import Outgoing
from service.localise.scenery import NoScenery, SceneryState
from service.mavlink.links import MavlinkLinks
from service.publish.exchange.tak.switch import NullTak
from service.publish.zenoh import NullPublisher
from service.recordings.posed_frames import PosedFrames
from service.recordings.recorder import NullRecorder
from service.recordings.recording import Recording
from tests.support.places import CUT


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
