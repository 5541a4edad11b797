"""The recipes of docs/cameras.md that can be run without a camera; skipped where the programs are not installed."""

import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from distloc.geometry.camera import Camera
from service.camera import command
from service.camera.sources import open_source
from service.config.sections import SourceConfig
from tests.support.films import write_film
from tests.support.places import ROOT

FILM = Camera(160, 120, 150.0, 150.0, 80.0, 60.0)
FULL_HD = Camera(1920, 1080, 1200.0, 1200.0, 960.0, 540.0)
ROW = re.compile(r"^\| (?P<name>[^|]+) \| `(?P<words>[^`]+)` \| `(?P<format>\w+)` \| here \|$", re.MULTILINE)
RECIPES = {row["name"]: row for row in ROW.finditer((ROOT / "docs/cameras.md").read_text(encoding="utf-8"))}
GST_FRAMES = str(Path(command.__file__).with_name("gst_frames.py"))
PYTHON = "/usr/bin/python3"


def frames_of(source: SourceConfig, camera: Camera, count: int = 3) -> list[int]:
    """How old each frame is when it is read, in nanoseconds."""
    if shutil.which(source.command[0]) is None:
        pytest.skip(f"{source.command[0]} is not installed")
    ages = []
    with open_source(source, camera, time.monotonic_ns) as reading:
        for _ in range(count):
            frame = reading.read()
            assert frame is not None and frame.image is not None
            assert frame.image.shape == (camera.height, camera.width, 3)
            ages.append(time.monotonic_ns() - frame.stamp_ns)
    return ages


def test_the_recipes_are_there() -> None:
    assert set(RECIPES) == {
        *("any RTSP camera", "anything that FFmpeg reads", "a test picture", "a film, again and again"),
    }


def _has_gstreamer_in_python() -> bool:
    asked = [PYTHON, "-c", "import gi; gi.require_version('GstApp', '1.0'); from gi.repository import GstApp"]
    return shutil.which(PYTHON) is not None and subprocess.run(asked, capture_output=True, check=False).returncode == 0


needs_gstreamer_in_python = pytest.mark.skipif(
    not _has_gstreamer_in_python(), reason="the system's Python has no GStreamer"
)


@pytest.mark.parametrize("name", sorted(set(RECIPES) - {"any RTSP camera"}))  # that one is in test_rtsp.py
def test_a_recipe_of_the_docs(name: str, tmp_path: Path) -> None:
    write_film(tmp_path / "film.mp4")
    row = RECIPES[name]
    words = row["words"].replace("film.mp4", "URL").replace("URL", str(tmp_path / "film.mp4")).split()
    source = SourceConfig(kind="command", command=tuple(words), format=row["format"], fps=1000.0)  # type: ignore[arg-type]
    frames_of(source, FULL_HD if name == "a test picture" else FILM)


@pytest.mark.parametrize("format", ["mjpeg", "nv12"])
def test_gstreamer_to_standard_output(format: str) -> None:
    caps = "video/x-raw,width=160,height=120,framerate=30/1,format=" + ("NV12" if format == "nv12" else "I420")
    encoder = ["!", "jpegenc"] if format == "mjpeg" else []
    words = ["gst-launch-1.0", "-q", "videotestsrc", "is-live=true", "!", caps, *encoder, "!", "fdsink", "fd=1"]
    frames_of(SourceConfig(kind="command", command=tuple(words), format=format, fps=1000.0), FILM)  # type: ignore[arg-type]


@needs_gstreamer_in_python
def test_gstreamers_own_times() -> None:
    pipeline = "videotestsrc is-live=true ! video/x-raw,width=160,height=120,framerate=10/1,format=BGR"
    source = SourceConfig(
        kind="command", command=(PYTHON, GST_FRAMES, pipeline), format="bgr", times="monotonic", fps=1000.0
    )
    ages = frames_of(source, FILM, 10)
    assert min(ages) > 0


@needs_gstreamer_in_python
def test_gst_frames_says_what_is_wrong() -> None:
    done = subprocess.run([PYTHON, GST_FRAMES], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and done.stderr.startswith("usage: gst_frames.py [--clock monotonic|unix] PIPELINE")
