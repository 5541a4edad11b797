"""A lens that is not as it was calibrated stops the frames, by whatever message it is told; and until it is back."""

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import CameraPose, RejectReason
from service.commands.check.payload import payload_findings
from service.config.sections import CameraConfig
from tests.service.autopilot.payload.rig import MS, Rig

NAN = math.nan
HFOV_DEG = math.degrees(2.0 * math.atan(960.0 / 1200.0))  # 77.3, the default camera's
VFOV_DEG = math.degrees(2.0 * math.atan(540.0 / 1200.0))
ZOOMED = RejectReason.ZOOMED


def fov(hfov_deg: float, vfov_deg: float = NAN, device: int = 0) -> Any:
    place = (0, 0, 0, 0, 0, 0)
    return mavlink.MAVLink_camera_fov_status_message(0, *place, [1.0, 0, 0, 0], hfov_deg, vfov_deg, device)


def level(percent: float, device: int = 0) -> Any:
    return mavlink.MAVLink_camera_settings_message(0, 0, percent, NAN, device)


def stream(hfov_deg: int, stream_id: int = 1, flags: int = 1, device: int = 0) -> Any:
    sizes = (30.0, 1920, 1080, 4000, 0, hfov_deg)
    return mavlink.MAVLink_video_stream_information_message(stream_id, 1, 0, flags, *sizes, b"", b"", 0, device)


def flying(**options: Any) -> Rig:
    rig = Rig(camera=CameraConfig(**options), gimbal=False)
    rig.fly(1.0)
    return rig


@pytest.mark.parametrize(
    ("message", "is_zoomed"),
    [
        (fov(HFOV_DEG), False),
        (fov(HFOV_DEG * 1.03), False),
        (fov(HFOV_DEG * 0.97), False),
        (fov(HFOV_DEG * 1.06), True),
        (fov(HFOV_DEG / 2.0), True),
        (fov(0.0, 0.0), False),
        (fov(NAN, NAN), False),
        (fov(-1.0), False),
        (fov(math.inf), False),
        (fov(NAN, VFOV_DEG / 2.0), True),
        (fov(0.0, VFOV_DEG), False),
        (level(0.0), False),
        (level(0.3), False),
        (level(10.0), True),
        (level(NAN), False),
        (level(-1.0), False),
        (stream(77), False),
        (stream(78), False),
        (stream(0), False),
        (stream(40), True),
        (stream(40, flags=3), False),  # thermal
    ],
)
@pytest.mark.parametrize("component", [1, 100, 101, 105])
def test_what_the_camera_says_of_its_lens(message: Any, is_zoomed: bool, component: int) -> None:
    rig = flying()
    rig.hear(message, component)
    rig.fly(0.5)
    assert (rig.look() is ZOOMED) is is_zoomed is ("zoom" in rig.degraded())
    assert (len(payload_findings(rig.autopilot, rig.now_ns)) == 1) is is_zoomed


@pytest.mark.parametrize(("off", "back"), [(fov(30.0), fov(77.0)), (level(50.0), level(0.0)), (stream(30), stream(77))])
def test_frames_count_again_once_the_lens_is_back(off: Any, back: Any) -> None:
    rig = flying()
    rig.hear(off, 101)
    rig.fly(30.0)  # silence changes nothing
    assert rig.look() is ZOOMED and "zoom" in rig.degraded()
    rig.hear(back, 101)
    back_ns = rig.now_ns
    rig.fly(0.6)
    assert "zoom" not in rig.degraded()
    assert rig.autopilot.camera_pose(back_ns - MS, rig.now_ns) is ZOOMED  # it was taken on the way back
    assert isinstance(rig.autopilot.camera_pose(back_ns + MS, rig.now_ns), CameraPose)


def test_our_own_view_that_comes_back_gives_no_zoomed_camera_its_frames_back() -> None:
    rig = flying()
    rig.hear(fov(30.0), 100)  # a camera that has our camera's id
    rig.hear(fov(*map(math.degrees, CameraConfig().camera().fov_rad)), 100)
    rig.fly(0.5)
    assert rig.look() is ZOOMED
    rig.hear(fov(77.0), 100)
    rig.fly(0.5)
    assert isinstance(rig.look(), CameraPose)


def test_a_word_from_before_the_zoom_that_comes_late_by_a_second_path_takes_nothing_back() -> None:
    rig = flying()
    before, after = fov(HFOV_DEG), fov(20.0)
    before.time_boot_ms, after.time_boot_ms = rig.boot_ms, rig.boot_ms + 1000
    for message in (before, after, before):
        rig.hear(message, 100)
    rig.fly(1.0)
    assert rig.look() is ZOOMED and rig.autopilot.ignored["copy"] == 1


def test_words_of_another_kind_camera_or_system_take_none_back() -> None:
    rig = flying()
    rig.hear(level(40.0), 101)
    for message, component in ((fov(HFOV_DEG), 101), (level(0.0), 102), (level(0.0, device=2), 1)):
        rig.hear(message, component)
    rig.hear(level(0.0), 101, system=7)
    rig.fly(0.5)
    assert rig.look() is ZOOMED
    other = flying()
    other.hear(level(40.0), 101, system=7)
    other.fly(0.5)
    assert isinstance(other.look(), CameraPose)


@pytest.mark.parametrize(("device", "component", "device_id"), [(101, 101, 0), (2, 1, 2), (1, 1, 0)])
def test_the_configured_camera_alone_counts(device: int, component: int, device_id: int) -> None:
    rig = flying(device=device)
    rig.hear(level(40.0), 103)
    rig.hear(level(40.0, device=3), 1)
    rig.fly(0.5)
    assert isinstance(rig.look(), CameraPose)
    rig.hear(level(40.0, device=device_id), component)
    rig.fly(0.5)
    assert rig.look() is ZOOMED


def test_a_camera_that_was_calibrated_zoomed() -> None:
    rig = flying(zoom_level=40.0)
    rig.hear(level(40.0), 101)
    rig.fly(0.5)
    assert isinstance(rig.look(), CameraPose)
    rig.hear(level(0.0), 101)
    rig.fly(0.5)
    assert rig.look() is ZOOMED
    assert rig.autopilot.counters()["zoom"] == ("camera 101: zoom level 0 %, calibrated at 40 % (camera.zoom_level)")


def test_of_several_streams_of_a_camera_one_has_to_agree() -> None:
    rig = flying()
    rig.hear(stream(30, stream_id=1), 101)
    rig.hear(stream(77, stream_id=2), 101)
    rig.fly(0.5)
    assert isinstance(rig.look(), CameraPose)
    rig.hear(stream(50, stream_id=2), 101)
    rig.fly(0.5)
    assert rig.look() is ZOOMED


def test_many_cameras_take_no_more_memory() -> None:
    rig = flying()
    for component in range(2, 200):
        rig.hear(fov(HFOV_DEG), component)
        rig.hear(stream(77, stream_id=component), 101)
    assert len(rig.autopilot.zoom._words) == 16
    rig.hear(level(40.0), 150)  # but what differs is always kept
    assert len(rig.autopilot.zoom._words) == 16 and "zoom" in rig.degraded()
