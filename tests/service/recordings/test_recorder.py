import os
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.recordings import recorder as recorder_module
from service.recordings.flights import Flights, flights_in, is_own
from service.recordings.recorder import NullRecorder, Recorder
from service.recordings.recording import Recording
from service.recordings.tlog import read_tlog
from tests.support.places import HANG_S

HEARTBEAT = bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 1, 1)))
IMAGE = np.full((48, 64, 3), 128, dtype=np.uint8)


def test_a_recording_as_the_contract_has_it(tmp_path: Path) -> None:
    recorder = Recorder(unix_offset_ns=1_000_000_000)
    recorder.open(tmp_path / "flight", "vehicle = 'drone1'\n")
    recorder.telemetry(5_000, b"\xfdframe")
    recorder.telemetry(7_999, b"\xfeother")
    recorder.frame(9_000, "000001.png", IMAGE)
    recorder.close()
    folder = flight_in(tmp_path / "flight")
    log = (folder / "telemetry.tlog").read_bytes()
    assert log == struct.pack(">Q", 1_000_005) + b"\xfdframe" + struct.pack(">Q", 1_000_007) + b"\xfeother"
    assert (folder / "frames.csv").read_text() == "stamp_us,file\n1000009,000001.jpg\n"
    assert (folder / "config.toml").read_text() == "vehicle = 'drone1'\n"
    assert [path.name for path in (folder / "frames").iterdir()] == ["000001.jpg"]
    image = cv2.imread(str(folder / "frames" / "000001.jpg"))
    assert image is not None and image.shape == IMAGE.shape
    assert (recorder.state, recorder.written, recorder.dropped) == ("closed", 3, 0)


def test_the_landmarks_templates_are_kept_and_such_a_flight_is_still_our_own(tmp_path: Path) -> None:
    recorder = Recorder(unix_offset_ns=1_000_000_000)
    recorder.open(tmp_path, "", {"mast": b"picture"})
    recorder.telemetry(5_000, b"frame")
    recorder.close()
    folder = flight_in(tmp_path)
    assert (folder / "landmarks" / "mast.png").read_bytes() == b"picture"
    assert is_own(folder)
    (folder / "landmarks" / "notes.txt").write_text("mine")
    assert not is_own(folder)


def test_without_frames_only_telemetry(tmp_path: Path) -> None:
    recorder = Recorder(save_frames=False)
    recorder.open(tmp_path, "")
    recorder.frame(0, "a", IMAGE)
    recorder.close()
    assert (flight_in(tmp_path) / "frames.csv").read_text() == "stamp_us,file\n"


def test_a_full_queue_drops_and_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held, entered = threading.Event(), threading.Event()
    real = cv2.imencode

    def slow(*arguments: object) -> object:
        entered.set()
        assert held.wait(10.0)
        return real(*arguments)  # type: ignore[call-overload]

    monkeypatch.setattr(recorder_module.cv2, "imencode", slow)
    recorder = Recorder()
    recorder.open(tmp_path, "")
    recorder.frame(0, "first", IMAGE)
    assert entered.wait(10.0)
    for number in range(10):
        recorder.frame(number, f"f{number}", IMAGE)
    assert recorder.dropped == 10 - recorder_module.QUEUE_FRAMES
    held.set()
    recorder.close()
    assert len((flight_in(tmp_path) / "frames.csv").read_text().splitlines()) == 1 + 1 + recorder_module.QUEUE_FRAMES


def test_a_disk_that_fails_stops_the_recording_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Recorder, "_write_image", full)
    recorder = Recorder()
    recorder.open(tmp_path, "")
    recorder.frame(0, "a", IMAGE)
    recorder.close()
    recorder.telemetry(0, b"x")
    assert recorder.state.startswith("stopped: [Errno 28]")
    assert recorder.counters["recorder_errors"] == 1
    assert (flight_in(tmp_path) / "frames.csv").read_text() == "stamp_us,file\n"


def test_a_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    recorder = Recorder()
    recorder.open(tmp_path / "file" / "flight", "")
    recorder.close()
    assert recorder.state.startswith("stopped")


def test_the_null_recorder_does_nothing(tmp_path: Path) -> None:
    recorder = NullRecorder()
    recorder.open(tmp_path, "")
    recorder.telemetry(0, b"")
    recorder.frame(0, "a", None)
    recorder.close()
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_was_full_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "RETRY_PERIOD_S", 0.01)
    monkeypatch.setattr(Flights, "begin", lambda self, utc_s: begun(self, tmp_path))
    (tmp_path / "telemetry.tlog").symlink_to("/dev/full")
    (tmp_path / "frames.csv").write_text("stamp_us,file\n1,a.jpg\n2,b.j")
    recorder = Recorder(unix_offset_ns=0)
    recorder.open(tmp_path, "")
    wait_for(recorder, lambda: recorder.is_lost)
    assert "No space left" in recorder.state or recorder.state == "recording"
    (tmp_path / "telemetry.tlog").unlink()
    wait_for(recorder, lambda: not recorder.is_lost)
    recorder.close()
    assert recorder.errors >= 1 and (recorder.state, recorder.is_lost) == ("closed", False)
    assert (tmp_path / "telemetry.tlog").read_bytes().endswith(b"\xfdframe")
    assert (tmp_path / "frames.csv").read_text() == "stamp_us,file\n1,a.jpg\n"


def test_whatever_error_the_recorder_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "RETRY_PERIOD_S", 0.01)
    failures = iter([RuntimeError("odd"), MemoryError()])
    real = recorder_module._cut_torn_row

    def fails_twice(table: Path) -> None:
        if (error := next(failures, None)) is not None:
            raise error
        real(table)

    monkeypatch.setattr(recorder_module, "_cut_torn_row", fails_twice)
    monkeypatch.setattr(Flights, "begin", lambda self, utc_s: begun(self, tmp_path))
    (tmp_path / "frames.csv").write_text("stamp_us,file\n")
    recorder = Recorder(unix_offset_ns=0)
    recorder.open(tmp_path, "")
    wait_for(recorder, lambda: recorder.errors == 2 and not recorder.is_lost)
    recorder.close()
    assert (recorder.state, recorder.is_lost) == ("closed", False) and recorder.written > 0


def test_telemetry_is_written_soon_and_a_flood_of_it_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = Recorder(unix_offset_ns=0)
    recorder.open(tmp_path, "")
    recorder.telemetry(5_000, b"\xfdframe")
    until(lambda: recorder.written == 1)
    monkeypatch.setattr(recorder_module, "FLUSH_PERIOD_S", 1e6)  # from the next wait on it looks when it is woken alone
    recorder.frame(6_000, "wakes", IMAGE)
    until(lambda: recorder.written == 2)
    flood = recorder_module.QUEUE_TELEMETRY // 2 + 1
    for number in range(flood):
        recorder.telemetry(number, b"\xfdframe")
    until(lambda: recorder.written == 2 + flood)
    recorder.close()
    assert (recorder.state, recorder.dropped) == ("closed", 0)


def test_a_folder_on_another_disk_is_not_written_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "RETRY_PERIOD_S", 0.01)
    folder = tmp_path / "flight"
    recorder = Recorder(unix_offset_ns=0)
    recorder.open(folder, "")
    wait_for(recorder, lambda: recorder.written > 0)
    recorder._device = -1  # as if a disk had been mounted there
    flight = flight_in(folder)
    folder.rename(tmp_path / "elsewhere")
    wait_for(recorder, lambda: "another disk" in recorder.state)
    recorder.close()
    assert flight.is_dir() and not (flight / "telemetry.tlog").exists()


def test_a_second_run_leaves_the_first_flight_as_it_is(tmp_path: Path) -> None:
    for run in (1, 2):
        recorder = Recorder(unix_offset_ns=0)
        recorder.open(tmp_path, "")
        for number in range(3):
            recorder.telemetry(number * 1000, b"\xfdframe")
            recorder.frame(1000 + number * 1000, f"{number:06d}", np.full((48, 64, 3), 60 * run, np.uint8))
            written(recorder, 2 + 2 * number)
        recorder.close()
    first, second = flights_in(tmp_path)
    assert recorder.counters["recorder_flight"] == second.name
    for flight, level in ((first, 60), (second, 120)):
        recording = Recording(flight)
        assert [name for _, name in recording.frames()] == ["000000.jpg", "000001.jpg", "000002.jpg"]
        for _, name in recording.frames():
            image = recording.load_image(name)
            assert image is not None and abs(float(image.mean()) - level) < 2.0


def test_a_camera_that_counts_anew_replaces_no_picture(tmp_path: Path) -> None:
    recorder = Recorder(unix_offset_ns=0)
    recorder.open(tmp_path, "")
    for number in range(3):
        recorder.frame(1000 + number * 1000, "000000", np.full((48, 64, 3), 60 * number, np.uint8))
        written(recorder, 1 + number)
    recorder.telemetry(9000, b"\xfdframe")
    recorder.close()
    recording = Recording(flight_in(tmp_path))
    images = [recording.load_image(name) for _, name in recording.frames()]
    assert [round(float(image.mean()) / 60) for image in images if image is not None] == [0, 1, 2]


@pytest.mark.parametrize("unix_offset_ns", [0, -(10**18)])
def test_a_computer_without_a_clock_writes_what_can_be_replayed(tmp_path: Path, unix_offset_ns: int) -> None:
    recorder = Recorder(unix_offset_ns)
    recorder.open(tmp_path, "")
    for number in range(50):
        recorder.telemetry(62 * 10**9 + number * 10**7, HEARTBEAT)
    recorder.frame(62 * 10**9, "000001", IMAGE)
    recorder.close()
    recording = Recording(flight_in(tmp_path))
    assert recording.frames() == [(62_000_000, "000001.jpg")]
    assert [stamp_us for stamp_us, _ in read_tlog(recording.tlog_path)] == [62_000_000 + 10_000 * n for n in range(50)]


def test_a_disk_that_hangs_is_told_by_the_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "CLOSE_TIMEOUT_S", 0.0)
    monkeypatch.setattr(Flights, "begin", lambda self, utc_s: begun(self, tmp_path))
    os.mkfifo(tmp_path / "telemetry.tlog")  # opened, but not by both ends: as on a server that is away
    now_ns = [10**12]
    recorder = Recorder(unix_offset_ns=0, clock=lambda: now_ns[0])
    recorder.open(tmp_path, "")
    until((tmp_path / "config.toml").exists)
    recorder.telemetry(0, b"\xfdframe")
    assert not recorder.is_lost and recorder.state == "recording"
    now_ns[0] += recorder_module.HUNG_NS + 1
    assert recorder.is_lost and recorder.counters["recorder_state"] == "hung: the disk has not answered for 3 s"
    reader = os.open(tmp_path / "telemetry.tlog", os.O_RDONLY | os.O_NONBLOCK)  # the server is back
    until(lambda: recorder.written == 1 and not recorder.is_lost)
    monkeypatch.setattr(recorder_module, "CLOSE_TIMEOUT_S", 20.0)
    recorder.close()
    os.close(reader)
    assert recorder.state == "closed"


def test_a_disk_that_is_too_full_is_left_some_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "RETRY_PERIOD_S", 0.01)
    recorder = Recorder(unix_offset_ns=0, least_free_gb=1e6)
    recorder.open(tmp_path, "")
    until(lambda: recorder.is_lost)
    assert "below recorder.least_free_gb of 1e+06" in recorder.state
    recorder.close()
    assert list(tmp_path.iterdir()) == []


def flight_in(folder: Path) -> Path:
    """The only flight in a recorder's folder."""
    (flight,) = flights_in(folder)
    return flight


def begun(flights: Flights, folder: Path) -> Path:
    """As if the run had begun in this folder."""
    flights.flown = folder
    return folder


def written(recorder: Recorder, count: int) -> None:
    """Wait until so much is written."""
    until(lambda: recorder.written == count)


def until(condition: Callable[[], bool]) -> None:
    """Wait for what comes by itself."""
    end_s = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.001)


def wait_for(recorder: Recorder, condition: Callable[[], bool]) -> None:
    """Feed it until a condition holds."""
    end_s = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < end_s, recorder.state
        recorder.telemetry(5_000, b"\xfdframe")
        time.sleep(0.001)
