"""Faults of camera and model, each put into the running service; docs/faults.md says what must come."""

import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from distloc.types import CameraPose, RejectReason
from service.common.messages import Frame
from service.segmenters.segment import Mask
from tests.faults.harness import Flight
from tests.support.places import HANG_S, ROOT

SLOW_S = 10.0


@pytest.fixture(scope="module")
def flight() -> Iterator[Flight]:
    with Flight() as made:
        yield made


def test_no_camera_at_the_start() -> None:
    with Flight(has_camera=False) as flight:
        operator = flight.operator
        operator.wait_for(lambda: operator.degraded() == ("camera",), "status says camera", HANG_S)
        operator.wait_for(lambda: "distloc degraded: camera" in operator.texts_since(0.0), "so does a text", HANG_S)
        with flight.fault("no camera at the start", is_from_start=True) as fault:
            fault.outcome.degraded.append("camera")
            fault.began_s = 0.0
            flight.device.is_plugged = True


def test_camera_frozen(flight: Flight) -> None:
    with flight.fault("camera frozen", degraded="camera_frozen", reject="frozen_frame") as fault:
        flight.device.is_frozen = True
        fault.ends_with(lambda: setattr(flight.device, "is_frozen", False))


def test_camera_black(flight: Flight) -> None:
    with flight.fault("camera black", degraded="camera_blind", reject="blind_frame") as fault:
        given, localised = flight.device.given, flight.app.pipeline.stage.frames
        flight.device.is_black = True
        fault.ends_with(lambda: setattr(flight.device, "is_black", False))
        fault.see(lambda: flight.device.given > given + 20, "20 were black, four times what dismisses a target")
        assert flight.app.pipeline.stage.frames < localised + 5
        assert flight.operator.confirmed == {flight.target}


def test_camera_overexposed(flight: Flight) -> None:
    with flight.fault("camera overexposed", degraded="camera_blind", reject="blind_frame") as fault:
        flight.device.is_white = True
        fault.ends_with(lambda: setattr(flight.device, "is_white", False))


def test_camera_slow(flight: Flight) -> None:
    with flight.fault("camera slow: a frame in 8 s", degraded="camera") as fault:
        period_s, flight.device.period_s = flight.device.period_s, 8.0  # long enough to be told
        fault.ends_with(lambda: setattr(flight.device, "period_s", period_s))


def test_camera_changes_to_a_size_that_cannot_be(flight: Flight) -> None:
    with flight.fault("camera changes to another shape", degraded="camera", reject="bad_frame") as fault:
        flight.device.size = (300, 200)
        fault.ends_with(lambda: setattr(flight.device, "size", None))


def test_camera_changes_to_half_the_size(flight: Flight) -> None:
    with flight.fault("camera changes to half the size") as fault:
        given = flight.app.pipeline.stage.frames
        flight.device.size = (160, 90)
        fault.ends_with(lambda: setattr(flight.device, "size", None))
        fault.see(lambda: flight.app.pipeline.stage.frames > given + 10, "frames go on")


def test_camera_unplugged(flight: Flight) -> None:
    with flight.fault("camera unplugged", degraded="camera") as fault:
        flight.device.is_plugged = False
        fault.ends_with(lambda: setattr(flight.device, "is_plugged", True))


def test_corrupt_jpegs(flight: Flight) -> None:
    with flight.fault("corrupt JPEGs", reject="bad_frame") as fault:
        given = flight.device.given
        flight.device.is_corrupt = True
        fault.ends_with(lambda: setattr(flight.device, "is_corrupt", False))
        fault.see(lambda: flight.device.given > given + 15, "15 were spoilt")


def void(_: object) -> None:
    """Nothing."""


class FaultySegmenter:
    """The segmenter of the service with something before it."""

    def __init__(self, flight: Flight, before: Callable[[], None]) -> None:
        self.name = "faulty"
        self.calls = 0
        self._stage, self._inner, self._before = flight.app.pipeline.stage, flight.app.pipeline.stage.segmenter, before
        self._stage.segmenter = self

    def segment(self, frame: Frame, pose: CameraPose | None) -> Mask | RejectReason:
        self.calls += 1
        self._before()
        return self._inner.segment(frame, pose)

    def remove(self) -> None:
        self._stage.segmenter = self._inner


def test_model_raises(flight: Flight) -> None:
    def fail() -> None:
        raise RuntimeError("the model failed")

    with flight.fault("model raises", degraded="segmenter", reject="segmentation_failed") as fault:
        fault.ends_with(FaultySegmenter(flight, fail).remove)


def test_model_floods(flight: Flight, monkeypatch: pytest.MonkeyPatch) -> None:
    with flight.fault("model floods", degraded="segmenter", reject="segmentation_flooded") as fault:
        monkeypatch.setattr(flight.app.pipeline.stage.segmenter, "_flood_share", 1e-6)
        fault.ends_with(monkeypatch.undo)


def test_model_takes_ten_seconds(flight: Flight) -> None:
    ended = threading.Event()
    with flight.fault("model takes 10 s", degraded="segmenter") as fault:
        slow = FaultySegmenter(flight, lambda: void(ended.wait(SLOW_S)))
        fault.see(lambda: slow.calls > 1, "a frame took 10 s")
        dropped = flight.app.frames.dropped

        def end() -> None:
            assert flight.app.frames.dropped >= dropped > 0
            ended.set()
            slow.remove()

        fault.ends_with(end)


def test_the_process_starts_without_its_camera_and_ends_when_told(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text('[camera.source]\nkind = "v4l2"\npath = "/dev/video99"\n[zenoh]\nenabled = false\n')
    command = [sys.executable, "-m", "service", "run", "--config", str(config)]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        killer = threading.Timer(HANG_S, process.kill)
        killer.start()
        assert process.stderr is not None
        assert any("ready" in line for line in process.stderr)
        process.send_signal(signal.SIGTERM)
        assert process.wait(HANG_S) == 0
        killer.cancel()
