"""What the pilot hears of the compass."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.geometry.camera import Camera
from service.localise.scenery import HELD_S, NoScenery, SceneryState
from service.publish.mavlink import MavlinkPublisher
from service.publish.pilot.compass_teller import CompassTeller

S = 1_000_000_000


def off_by(error_deg: float, off_s: float = HELD_S) -> SceneryState:
    """Of a compass that reads too much by so many degrees."""
    error_rad = np.radians([0.1, 0.2, -error_deg])
    return SceneryState("scenery", 0.0, error_rad, np.radians([0.1, 0.1, 0.3]), 40, {}, off_s)


@pytest.mark.parametrize(
    ("error_deg", "text"),
    [(-3.2, b"Compass off by -3.2 deg"), (3.2, b"Compass off by +3.2 deg"), (-180.0, b"Compass off by -180.0 deg")],
)
def test_it_is_told_with_its_side_once_it_has_held(error_deg: float, text: bytes) -> None:
    pilot = CompassTeller()
    assert pilot.due(off_by(error_deg, HELD_S - 0.1), 0) is None
    assert pilot.due(off_by(error_deg), S) == text
    assert len(text) <= 50


def test_it_is_told_again_where_it_changed_and_at_most_every_two_minutes() -> None:
    pilot = CompassTeller()
    pilot.due(off_by(-3.2), 0)
    assert [pilot.due(off_by(-3.2), at_s * S) for at_s in (1, 130, 3600)] == [None] * 3
    pilot = CompassTeller()
    pilot.due(off_by(-3.2), 0)
    assert pilot.due(off_by(-5.3), 119 * S) is None
    assert pilot.due(off_by(-5.1), 121 * S) is None
    assert pilot.due(off_by(-5.3), 121 * S) == b"Compass off by -5.3 deg"
    assert pilot.due(off_by(3.0), 122 * S) is None
    assert pilot.due(off_by(3.0), 300 * S) == b"Compass off by +3.0 deg"


def test_who_knows_nothing_is_silent() -> None:
    pilot = CompassTeller()
    assert pilot.due(NoScenery.state, 0) is None
    assert pilot.due(SceneryState("autopilot", off_s=60.0), 0) is None
    assert pilot.due(off_by(9.0).at(60.0), 0) is None


def test_it_goes_out_once_as_a_notice_and_waits_for_the_autopilot_to_be_known() -> None:
    made = MavlinkPublisher(Camera(1920, 1080, 1200.0, 1200.0, 959.5, 539.5))
    assert made.due(0, 0, (), None, off_by(-3.2)) == []
    made.set_system(7)
    sent = [frame for tick in range(50) for frame in made.due(tick * S // 10, 0, (), None, off_by(-3.2))]
    messages = [mavlink.MAVLink(None).decode(bytearray(frame)) for frame in sent]
    texts = [(one.text, one.severity) for one in messages if one.get_type() == "STATUSTEXT"]
    assert texts == [("Compass off by -3.2 deg", mavlink.MAV_SEVERITY_NOTICE)]
