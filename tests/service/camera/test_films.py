"""Films by their own time, files at their own speed, and what a V4L2 camera is asked for."""

import asyncio
import logging
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.camera import Camera
from service.camera.paced import PacedSource
from service.camera.sources import SizeError, SourceError, VideoSource, open_source
from service.common.messages import Frame
from service.config.sections import CameraConfig, Config, ConfigError, SourceConfig, ZenohConfig
from service.flight.app import App
from service.recordings.recording import Recording
from tests.support.films import number_of, write_film

CAMERA = Camera(160, 120, 150.0, 150.0, 80.0, 60.0)


def test_a_films_frames_have_the_films_own_times(tmp_path: Path) -> None:
    times_s = write_film(tmp_path / "film.mp4")
    with VideoSource(tmp_path / "film.mp4", 1000.0, lambda: 5, CAMERA) as source:
        stamps = {
            number_of(frame.image): frame.stamp_ns for frame in iter(source.read, None) if frame.image is not None
        }
    assert sorted(stamps) == list(range(60))
    assert [stamps[number] for number in range(60)] == pytest.approx([5 + 1e9 * time_s for time_s in times_s], abs=1e6)


def test_a_film_is_thinned_by_its_own_time(tmp_path: Path) -> None:
    write_film(tmp_path / "film.mp4")  # 1 s at 20, 2 s at 10, 3 s at 20/3 a second
    with VideoSource(tmp_path / "film.mp4", 5.0, lambda: 0, CAMERA) as source:
        stamps_s = [frame.stamp_ns * 1e-9 for frame in iter(source.read, None)]
    assert stamps_s[:15] == pytest.approx([0.2 * number for number in range(15)], abs=1e-3)
    assert 27 <= len(stamps_s) <= 30 and np.diff(stamps_s).min() > 0.1


class Timeless:
    """A film whose container has no times."""

    def __init__(self, times_ms: list[float]) -> None:
        self.times_ms, self.number = times_ms, -1

    def grab(self) -> bool:
        self.number += 1
        return self.number < len(self.times_ms)

    def get(self, key: int) -> float:
        return self.times_ms[self.number] if key == cv2.CAP_PROP_POS_MSEC else 10.0

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.zeros((120, 160, 3), np.uint8)

    def release(self) -> None:
        pass


@pytest.mark.parametrize("times_ms", [[0.0] * 4, [float("nan")] * 4, [400.0, 300.0, 200.0, 100.0]])
def test_times_that_do_not_rise_go_on_at_the_mean_rate(tmp_path: Path, times_ms: list[float]) -> None:
    write_film(tmp_path / "film.mp4")
    source = VideoSource(tmp_path / "film.mp4", 1000.0, lambda: 0, CAMERA)
    source.close()
    source._capture, source._usual_s = Timeless(times_ms), 0.1  # type: ignore[assignment]
    stamps_s = [frame.stamp_ns * 1e-9 for frame in iter(source.read, None)]
    assert stamps_s == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_a_recordings_film_shows_the_frame_that_is_named(tmp_path: Path) -> None:
    write_film(tmp_path / "video.mp4")
    (tmp_path / "telemetry.tlog").write_bytes(bytes(20))
    recording = Recording(tmp_path)
    for number in (0, 5, 6, 30, 59, 41, 2, 2, 58):
        image = recording.load_image(f"{number:06d}")
        assert image is not None and number_of(image) == number
    assert recording.load_image("000060") is None and recording.load_image("000070") is None
    image = recording.load_image("000059")
    assert image is not None and number_of(image) == 59
    recording.close()


class ThreeFrames:
    def __init__(self) -> None:
        self.rejected: dict[str, int] = {}
        self.stamps_ns, self.closed = [100, 200, 300], False

    def read(self) -> Frame | None:
        return Frame(self.stamps_ns.pop(0), "x", None) if self.stamps_ns else None

    def close(self) -> None:
        self.closed = True


def test_a_files_frames_wait_for_their_time() -> None:
    now_ns, waits_s = [100], list[float]()

    def wait(left_s: float) -> bool:
        waits_s.append(left_s)
        now_ns[0] += 60  # woken early: it waits again
        return False

    source = PacedSource(ThreeFrames(), lambda: now_ns[0], wait)  # type: ignore[arg-type]
    given = [(frame.stamp_ns, now_ns[0]) for frame in iter(source.read, None)]
    assert given == [(100, 100), (200, 220), (300, 340)]
    assert waits_s == pytest.approx([100e-9, 40e-9, 80e-9, 20e-9])


def test_closing_ends_the_wait_at_once() -> None:
    waiting, inner = threading.Event(), ThreeFrames()

    def clock() -> int:
        waiting.set()
        return -(10**18)  # the first frame is due in 30 years

    source, got = PacedSource(inner, clock), list[Frame | None]()  # type: ignore[arg-type]
    reader = threading.Thread(target=lambda: got.append(source.read()))
    reader.start()
    assert waiting.wait(30.0)
    source.close()
    reader.join(30.0)
    assert got == [None] and inner.closed and source.read() is None


@pytest.mark.parametrize("kind", ["folder", "video"])
def test_a_flight_paces_files(tmp_path: Path, kind: str) -> None:
    write_film(tmp_path / "film.mp4")
    path = tmp_path if kind == "folder" else tmp_path / "film.mp4"
    config = SourceConfig(kind=kind, path=str(path))  # type: ignore[arg-type]
    assert isinstance(open_source(config, CAMERA, lambda: 0, is_paced=True), PacedSource)
    assert not isinstance(open_source(config, CAMERA, lambda: 0), PacedSource)


class Device:
    """What OpenCV makes of a V4L2 camera that has one size only."""

    def __init__(self, *_: object) -> None:
        self.asked: list[tuple[int, float]] = []
        self.has = {cv2.CAP_PROP_FRAME_WIDTH: 640.0, cv2.CAP_PROP_FRAME_HEIGHT: 480.0, cv2.CAP_PROP_FPS: 30.0}

    def isOpened(self) -> bool:
        return True

    def set(self, key: int, value: float) -> None:
        self.asked.append((key, value))

    def get(self, key: int) -> float:
        return self.has.get(key, 0.0)

    def grab(self) -> bool:
        return True

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.zeros((480, 640, 3), np.uint8)

    def release(self) -> None:
        pass


def test_a_v4l2_camera_is_asked_for_the_configs_size_and_rate(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    device = Device()
    monkeypatch.setattr("cv2.VideoCapture", lambda *_: device)
    config = SourceConfig(kind="v4l2", path="/dev/null", fps=5.0)
    with caplog.at_level(logging.WARNING):
        source = open_source(config, Camera(1920, 1080, 1200.0, 1200.0, 960.0, 540.0), lambda: 0)
    mjpg = cv2.VideoWriter.fourcc(*"MJPG")
    wanted = [(cv2.CAP_PROP_FOURCC, mjpg), (cv2.CAP_PROP_FRAME_WIDTH, 1920)]
    assert device.asked[-4:] == [*wanted, (cv2.CAP_PROP_FRAME_HEIGHT, 1080), (cv2.CAP_PROP_FPS, 5.0)]
    assert "/dev/null: asked for MJPG of 1920 x 1080, 5 a second; it gives another format of 640 x 480" in caplog.text
    with pytest.raises(SourceError, match="1920 x 1080: the source gives 640 x 480"):
        source.read()


def test_a_camera_of_another_size_ends_the_flight_as_a_wrong_config(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((50, 60, 3), np.uint8))
    source = SourceConfig(kind="folder", path=str(tmp_path))
    config = Config(camera=CameraConfig(source=source), zenoh=ZenohConfig(enabled=False))
    with pytest.raises(SizeError, match=r"1920 x 1080: the source gives 60 x 50") as caught:
        asyncio.run(App(config).run(asyncio.Event()))
    assert isinstance(caught.value, ConfigError)  # exit code 78
