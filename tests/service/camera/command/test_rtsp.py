"""RTSP from a real server (GStreamer's), whose picture shows when it was taken: stamps are right, packets lost or not.

Skipped where the system's Python has no GStreamer: apt-get install python3-gi gir1.2-gst-rtsp-server-1.0
gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly gstreamer1.0-libav.
"""

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from distloc.geometry.camera import Camera
from service.camera import command
from service.camera.sources import FrameSource, open_source
from service.common.messages import Frame
from service.config.sections import SourceConfig
from tests.support.drawn_clock import clock_ms_of
from tests.support.lossy_relay import LossyRelay
from tests.support.places import HANG_S, ROOT

PYTHON = "/usr/bin/python3"
NEEDS = "; ".join(
    [
        "import gi",
        "gi.require_version('GstRtspServer', '1.0')",
        "from gi.repository import Gst, GstRtspServer",
        "Gst.init(None)",
        "assert all(Gst.ElementFactory.find(name) for name in ('x264enc', 'avdec_h264', 'rtspsrc', 'rtph264pay'))",
    ]
)
WIDTH, HEIGHT = 640, 360
CAMERA = Camera(WIDTH, HEIGHT, 300.0, 300.0, 320.0, 180.0)
DECODED = (
    "! rtph264depay wait-for-keyframe=true ! avdec_h264 max-threads=1 output-corrupt=false ! videoconvert "
    "! video/x-raw,format=I420"
)


def has_gstreamer() -> bool:
    try:
        return subprocess.run([PYTHON, "-c", NEEDS], capture_output=True, check=False).returncode == 0
    except OSError:
        return False


pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not has_gstreamer(), reason="the system's Python has no GStreamer with an RTSP server"),
]


@contextmanager
def serving(*options: str, port: int = 0) -> Iterator[int]:
    """A server; its port."""
    words = [PYTHON, str(ROOT / "tests/support/rtsp_server.py"), str(port), *options]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield int(server.stdout.readline().split()[1])
        finally:
            server.kill()


def by_reports(url: str, protocol: str = "udp", more: str = "", latency_ms: float = 0.0) -> SourceConfig:
    """With the camera's own times, by RTCP's sender reports."""
    script = str(Path(command.__file__).with_name("gst_frames.py"))
    source = f"rtspsrc location={url} protocols={protocol} latency=100 add-reference-timestamp-meta=true {more}"
    words = (PYTHON, script, "--clock", "unix", source, DECODED)
    return SourceConfig(kind="command", command=words, format="i420", times="unix", fps=1000.0, latency_ms=latency_ms)


def read(source: FrameSource, count: int) -> list[Frame]:
    """So many frames; fails where they stay away."""
    found, end_s = [], time.monotonic() + HANG_S
    while len(found) < count:
        assert time.monotonic() < end_s
        frame = source.read()
        assert frame is not None
        found.append(frame)
    return found


def errors_ms(frames: list[Frame]) -> list[float]:
    """Stamps less the clock in the picture, of those whose clock can be read."""
    found = [(frame, clock_ms_of(frame.image)) for frame in frames if frame.image is not None]
    return [frame.stamp_ns * 1e-6 - clock_ms for frame, clock_ms in found if clock_ms is not None]


@pytest.mark.parametrize(("protocol", "loss"), [("udp", 0.0), ("udp", 0.05), ("tcp", 0.0)])
def test_stamps_are_those_of_the_picture(protocol: str, loss: float) -> None:
    with serving("fps=20") as port, LossyRelay(port, loss, seed=1) as relay:
        config = by_reports(f"rtsp://127.0.0.1:{relay.port}/clock", protocol)
        with open_source(config, CAMERA, time.monotonic_ns, is_awaited=True) as source:
            errors = np.array(errors_ms(read(source, 150)))
        assert (relay.lost > 10) == (loss > 0.0)
    # a few may be torn apart by the scheduler, between the server's look at its two clocks
    assert len(errors) >= 140 and np.percentile(np.abs(errors), 95) < 15.0, errors


@pytest.mark.parametrize("options", [("bframes=2",), ("audio=1",)])
def test_b_frames_and_audio_shift_the_stamps_by_a_constant(options: tuple[str, ...]) -> None:
    """This server's reports are of the time of sending: what it encodes for is `latency_ms`."""
    with serving(*options) as port:
        config = by_reports(f"rtsp://127.0.0.1:{port}/clock")
        with open_source(config, CAMERA, time.monotonic_ns, is_awaited=True) as source:
            errors = np.array(errors_ms(read(source, 40)))
    assert np.percentile(np.abs(errors - np.median(errors)), 90) < 15.0 and -15.0 < np.median(errors) < 1000.0, errors


@pytest.mark.parametrize("kind", ["command", "rtsp"])
def test_a_server_that_comes_back_at_half_the_size_with_a_password(kind: str) -> None:
    with serving("user=cam", "password=S3cret") as port:
        url = f"rtsp://cam:S3cret@127.0.0.1:{port}/clock"
        config = by_reports(url) if kind == "command" else SourceConfig(kind="rtsp", path=url, fps=1000.0)
        if kind == "command":  # a raw frame's size is told: another one needs Y4M
            config = as_y4m(config, url)
        source = open_source(config, CAMERA, time.monotonic_ns, is_awaited=True)
        shapes = {frame.image.shape for frame in read(source, 5) if frame.image is not None}
        assert shapes == {(HEIGHT, WIDTH, 3)}
    with serving("user=cam", "password=S3cret", "width=320", "height=180", port=port):
        while (frame := read(source, 1)[0]).image is None or frame.image.shape != (180, 320, 3):
            pass
        source.close()


def as_y4m(config: SourceConfig, url: str) -> SourceConfig:
    words = ["gst-launch-1.0", "-q", "rtspsrc", f"location={url}", "latency=0", *DECODED.split()]
    words += ["!", "queue", "leaky=downstream", "max-size-buffers=1", "!", "y4menc", "!", "fdsink", "fd=1"]
    return SourceConfig(kind="command", command=tuple(words), format="y4m", fps=1000.0)
