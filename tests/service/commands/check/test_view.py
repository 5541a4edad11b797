"""What the doctor says of the camera's numbers before it has a frame."""

from typing import Any

import pytest

from service.commands.check.view import check_view
from service.config.sections import CameraConfig, Config, MountConfig, PoseErrorsConfig, SourceConfig

RTSP = {"kind": "rtsp", "path": "rtsp://192.0.2.1/x"}
CALIBRATED: dict[str, Any] = {"fx": 1200.0, "fy": 1200.0, "cx": 960.0, "cy": 540.0}


def said(pose_errors: PoseErrorsConfig | None = None, **camera: Any) -> list[str]:
    config = Config(camera=CameraConfig(**camera), pose_errors=pose_errors or PoseErrorsConfig())
    return [str(finding) for finding in check_view(config)]


def test_the_view_in_degrees() -> None:
    assert said() == ["ok    view: 77 x 48 degrees, 1920 x 1080 pixels"]
    assert said(width=640, height=480, hfov_deg=60.0) == [
        "ok    view: 60 x 47 degrees, 640 x 480 pixels by camera.hfov_deg"
    ]
    fisheye = CameraConfig(model="fisheye", distortion=(0.0,) * 4, **CALIBRATED)
    assert check_view(Config(camera=fisheye))[0].said.startswith("92 x 52 degrees")


@pytest.mark.parametrize(
    ("latency_ms", "says"),
    [(0.0, "is 0: a rtsp camera's frames come later"), (4.0, "is 4: a rtsp"), (2500.0, "is 2500: over two seconds")],
)
def test_a_latency_that_no_camera_has(latency_ms: float, says: str) -> None:
    (line,) = said(source=SourceConfig(latency_ms=latency_ms, **RTSP))[1:]  # type: ignore[arg-type]
    assert line.startswith("warn  latency: camera.source.latency_ms " + says)


@pytest.mark.parametrize(
    "camera",
    [
        {"source": SourceConfig(kind="v4l2", path="/dev/video0", latency_ms=40.0)},
        {"source": SourceConfig(kind="video", path="x.mp4")},
        {"mount": MountConfig(pitch_deg=5.0)},
        {"mount": MountConfig(pitch_deg=30.0, gimbal=True)},
    ],
)
def test_what_is_in_order_is_not_warned_of(camera: dict[str, Any]) -> None:
    assert len(said(**camera)) == 1


def test_a_mount_that_looks_up() -> None:
    (line,) = said(mount=MountConfig(pitch_deg=15.0))[1:]
    assert line == (
        "warn  mount: camera.mount.pitch_deg is 15: the camera looks up, into the sky; negative pitch looks down"
    )


@pytest.mark.parametrize(
    ("camera", "warned"),
    [
        ({}, "fx, fy, cx, cy are of no calibration"),
        ({"hfov_deg": 70.0}, "fx, fy, cx, cy are of no calibration"),
        ({**CALIBRATED, "mount": MountConfig(yaw_deg=-90.0, pitch_deg=-4.5)}, "camera.mount (-90, -4.5, 0)"),
        ({**CALIBRATED, "mount": MountConfig(yaw_deg=-88.74, pitch_deg=-4.44, roll_deg=-0.37)}, ""),
    ],
)
def test_survey_needs_a_calibrated_mount(camera: dict[str, Any], warned: str) -> None:
    lines = said(PoseErrorsConfig(grade="survey"), **camera)[1:]
    assert (warned in lines[0] if warned else lines == []) and len(said(**camera)) == 1
    own = PoseErrorsConfig(grade="survey", heading_bias_deg=1.0, tilt_bias_deg=0.5)
    assert len(said(own, **camera)) == 1
