"""A command as the camera: its frames, its times, and one line for each way in which it may fail."""

import logging
import os
import re
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.camera.command.source import CommandSource
from service.camera.sources import SizeError, SourceError, open_source
from service.common.messages import Frame
from service.config.sections import SourceConfig
from tests.support.frame_writer import SIZE, writer
from tests.support.places import HANG_S

CAMERA = Camera(*SIZE, 100.0, 100.0, 32.0, 24.0)


def source(*verbs: str, is_awaited: bool = True, camera: Camera = CAMERA, **options: object) -> CommandSource:
    """Of the test's own child, which is started again without a wait."""
    config = SourceConfig(
        kind="command", command=writer(*verbs), **{"format": "bgr", "fps": 1000.0, "times": "monotonic", **options}
    )  # type: ignore[arg-type]
    return CommandSource(config, camera, time.monotonic_ns, is_awaited, wait=lambda _: False)


def level(frame: Frame | None) -> int:
    assert frame is not None and frame.image is not None and frame.image.shape == (SIZE[1], SIZE[0], 3)
    assert np.ptp(frame.image) == 0
    return int(frame.image[0, 0, 0])


def frame_of(reading: CommandSource) -> Frame:
    frame = reading.read()
    assert frame is not None
    return frame


def test_frames_are_stamped_at_their_arrival_less_latency() -> None:
    before_ns = time.monotonic_ns()
    with source("frames 3 0.1", "sleep", times="arrival", latency_ms=40.0) as reading:
        frames = [frame_of(reading) for _ in range(2)]
        after_ns = time.monotonic_ns()
    assert all(before_ns < frame.stamp_ns + 40_000_000 <= after_ns for frame in frames)
    assert [frame.name for frame in frames] == ["000001", "000002"]
    assert reading.read() is None


def test_its_own_times_are_taken_less_latency() -> None:
    with source("timed 3", "sleep", latency_ms=30.0) as reading:
        frames = [frame_of(reading) for _ in range(3)]
        age_ns = time.monotonic_ns() - frames[0].stamp_ns
    assert [level(frame) for frame in frames] == [1, 2, 3] and age_ns >= 530_000_000
    assert [frame.stamp_ns - frames[0].stamp_ns for frame in frames] == pytest.approx([0, 5e6, 10e6], abs=2)


def test_it_is_started_again_and_again() -> None:
    with source("timed 2", "exit 1") as reading:
        assert [level(reading.read()) for _ in range(10)] == [1, 2] * 5
        assert reading.starts == 5


def test_it_is_thinned_to_the_rate() -> None:
    with source("timed 100", "sleep", fps=20.0) as reading:
        assert [level(reading.read()) for _ in range(10)] == [1, *range(10, 100, 10)]


def test_closing_ends_a_read_that_waits(tmp_path: Path) -> None:
    reading, got = source(f"pid {tmp_path}/pid", "sleep"), list[Frame | None]()
    reader = threading.Thread(target=lambda: got.append(reading.read()))
    reader.start()
    while not (tmp_path / "pid").exists():
        time.sleep(0.005)
    reading.close()
    reader.join(HANG_S)
    assert got == [None] and reading.read() is None
    assert not Path(f"/proc/{(tmp_path / 'pid').read_text()}").exists()
    reading.close()  # twice is nothing


def test_nothing_is_left_over(tmp_path: Path) -> None:
    before, threads = set(os.listdir("/proc/self/fd")), threading.active_count()
    for _ in range(5):
        with source("timed 2", "exit 1") as reading:
            for _ in range(5):
                frame_of(reading)
    assert set(os.listdir("/proc/self/fd")) == before and threading.active_count() == threads


# What a command may do, and the line that says so; frames go on coming, as it is started again.
FAULTS = {
    "ends": (
        ("timed 2", "say no sensor", "exit 3"),
        r'ended with status 3 after 2 frames; its last words: "no sensor"',
    ),
    "crashes": (("timed 2", "die"), r"ended by SIGKILL after 2 frames; it said nothing"),
    "half a frame at its end": (
        ("timed 2", "part 1000"),
        r"ended with status 0 after 2 frames, 1000 bytes into the next",
    ),
    "floods its error output": (("timed 2", "flood 2"), r"it floods its error output, make it quieter"),
    "closes its output and stays": (
        ("timed 2", "close 1", "sleep"),
        r"closed its standard output and stayed after 2 frames",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_one_line_and_the_flight_goes_on(
    name: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    verbs, said = FAULTS[name]
    if "close 1" not in verbs:  # however slow the machine is, an end is noticed
        monkeypatch.setattr("service.camera.command.run._NOTICE_S", HANG_S)
    with caplog.at_level(logging.INFO), source(*verbs) as reading:
        assert [level(reading.read()) for _ in range(8)] == [1, 2] * 4
    line, *more = caplog.messages
    if name == "floods its error output" and "its last words" not in line:  # that was seen before its end
        line, *more = more
    assert line.startswith(f"camera.source.command, {writer()[0]}: ") and not more
    assert re.search(said, line), line
    assert "; it is started again, in 0." in line


def test_a_flood_is_told_once_while_frames_come(caplog: pytest.LogCaptureFixture) -> None:
    with source("flood 2", "frames 100000 0.01", times="arrival") as reading:
        while not caplog.messages:
            frame_of(reading)
        for _ in range(5):
            frame_of(reading)
    (line,) = caplog.messages
    assert "floods its error output, over 1 MB a second: make it quieter" in line and reading.starts == 1


def test_one_that_forks_and_stays_is_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with source("timed 2", f"leave {tmp_path}/pid") as reading:
        assert [level(reading.read()) for _ in range(4)] == [1, 2] * 2
    assert "ended with status 0 and left 1 process behind, ended too after 2 frames" in caplog.text


def test_a_missing_program_is_named_once_and_waited_for(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    program = tmp_path / "camera"
    config = SourceConfig(kind="command", command=(str(program), *writer("frames 1")[1:]), format="bgr")
    waits = list[float]()

    def wait(delay_s: float) -> bool:
        waits.append(delay_s)
        if len(waits) == 6:
            program.symlink_to(writer()[0])
        return False

    with CommandSource(config, CAMERA, time.monotonic_ns, True, wait) as reading:
        assert level(reading.read()) == 1
    assert len(caplog.messages) == 1 and f"{program}: cannot be started: No such file or directory;" in caplog.text
    assert 0.25 <= waits[0] <= 0.5 and 1.25 <= waits[5] <= 2.5


def test_a_missing_program_is_an_error_for_who_does_not_wait(tmp_path: Path) -> None:
    config = SourceConfig(kind="command", command=(f"{tmp_path}/camera",))
    with pytest.raises(SourceError, match=r"camera.source.command\[0\] is '.*/camera': no such program"):
        open_source(config, CAMERA, time.monotonic_ns)


def test_one_that_gives_no_frame_is_an_error_for_who_does_not_wait() -> None:
    with (
        source("say no camera", "exit 1", is_awaited=False) as reading,
        pytest.raises(SourceError, match='ended with status 1 after 0 frames; its last words: "no camera"'),
    ):
        reading.read()


def test_one_that_writes_nothing_is_started_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("service.camera.command.source._SILENT_S", 0.1)
    with source("part 100", "sleep", times="arrival") as reading:
        reader = threading.Thread(target=reading.read)
        reader.start()
        while reading.starts < 3:
            time.sleep(0.005)
        reading.close()
        reader.join(HANG_S)
    assert "gives no frame in 0.1 s" in caplog.messages[0] and "it is started again" in caplog.messages[0]


def test_another_size_than_the_configs_is_an_error_at_first() -> None:
    jpeg = cv2.imencode(".jpg", np.zeros((48, 80, 3), np.uint8))[1].tobytes()
    with (
        source("age 50", "text " + escaped(jpeg), "sleep", format="mjpeg") as reading,
        pytest.raises(SizeError, match="64 x 48: the source gives 80 x 48"),
    ):
        reading.read()


def test_a_size_that_changes_is_counted() -> None:
    good, other = (cv2.imencode(".jpg", np.full((48, width, 3), 90, np.uint8))[1].tobytes() for width in (64, 80))
    ages = ("age 400", "age 300", "age 200", "age 100")
    with source(*ages, "text " + escaped(good + other + other + good), "sleep", format="mjpeg") as reading:
        assert level(reading.read()) == level(reading.read()) == 90
    assert reading.rejected == {RejectReason.BAD_FRAME: 2}


def test_raw_frames_of_another_size_are_noticed(caplog: pytest.LogCaptureFixture) -> None:
    with source("frames 300 0.02 40 48", times="arrival") as reading:
        reader = threading.Thread(target=lambda: [reading.read() for _ in range(1000)])
        reader.start()
        while reading.starts < 2:
            time.sleep(0.005)
        reading.close()
        reader.join(HANG_S)
    assert "pauses in the midst of frames, 8 times: they have another size than camera.source.width" in caplog.text
    assert reading.rejected[RejectReason.BAD_FRAME] >= 7


@pytest.mark.parametrize(
    ("verbs", "said"),
    [
        (("frames 1", "sleep"), "writes no time of its frame 1 within 0.1 s to descriptor 3"),
        (("close 3", "frames 1", "sleep"), "writes no time of its frame 1"),
        (("line soon", "frames 1", "sleep"), "writes b'soon' as a frame's time: it must be milliseconds"),
    ],
)
def test_times_that_do_not_come_are_said(
    verbs: tuple[str, ...], said: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("service.camera.command.stream._LINE_S", 0.1)
    with source(*verbs) as reading:
        reader = threading.Thread(target=reading.read)
        reader.start()
        while reading.starts < 2:
            time.sleep(0.005)
        reading.close()
        reader.join(HANG_S)
    assert said in caplog.messages[0] and reading.rejected == {}


def test_times_on_another_clock_are_counted_and_said(caplog: pytest.LogCaptureFixture) -> None:
    with source("timed 30 -500000", "timed 1", "sleep") as reading:
        assert level(reading.read()) == 1
    assert reading.rejected == {RejectReason.BAD_FRAME: 30}
    assert 's after its arrival by camera.source.times = "monotonic": is it on that clock?' in caplog.text


def escaped(data: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in data)
