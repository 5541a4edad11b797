"""Reading recordings: junk, cuts, wild stamps, real logs."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.recordings.tlog import TlogReader, read_tlog
from tests.support.places import DATA

TELEMETRY = DATA / "telemetry"
START_US = 1_700_000_000_000_000


def record(index: int, stamp_us: int | None = None) -> bytes:
    mav = mavlink.MAVLink(None, 1, 1)
    frame = mavlink.MAVLink_attitude_message(index + 1, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6).pack(mav)
    return (START_US + index if stamp_us is None else stamp_us).to_bytes(8, "big") + bytes(frame)


def test_cut_in_the_middle_of_a_frame(tmp_path: Path) -> None:
    path = tmp_path / "cut.tlog"
    path.write_bytes(b"".join(record(i) for i in range(3000))[:-5])
    reader = TlogReader(path)
    assert [stamp_us for stamp_us, _ in reader] == [START_US + i for i in range(2999)]
    assert reader.frames == 2999 and reader.dropped_bytes == len(record(2999)) - 5


def test_junk_and_wild_stamps_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "junk.tlog"
    parts = [record(0), b"\xfe\xfd junk", record(1), record(2, 2**63), record(3, START_US + 10**15), record(4)]
    path.write_bytes(b"".join(parts))
    reader = TlogReader(path)
    assert [stamp_us - START_US for stamp_us, _ in reader] == [0, 1, 4]
    assert reader.dropped_bytes == len(parts[1] + parts[3] + parts[4])


def test_a_clock_that_was_set_is_followed_once_confirmed(tmp_path: Path) -> None:
    path = tmp_path / "set.tlog"
    path.write_bytes(record(0, 10**15) + b"".join(record(i) for i in range(1, 20)))
    assert len(list(read_tlog(path))) == 19  # the first one alone is wild


def test_a_raw_stream_is_told_from_a_log(tmp_path: Path) -> None:
    path = tmp_path / "raw.tlog"
    path.write_bytes(b"".join(record(i)[8:] for i in range(100)))
    reader = TlogReader(path)
    assert list(reader) == [] and reader.unstamped == 100
    path.write_bytes(b"".join(record(i) for i in range(100)))
    reader = TlogReader(path)
    assert len(list(reader)) == 100 and reader.unstamped == 0


def test_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "empty.tlog"
    path.write_bytes(b"")
    assert list(read_tlog(path)) == []


@pytest.mark.skipif(not TELEMETRY.is_dir(), reason="no recordings beside the repository")
@pytest.mark.parametrize(
    ("name", "least_frames", "most_dropped"),
    [("codelever_1.tlog", 10_000, 100), ("dronekit_flight_replay.tlog", 50_000, 60_000)],
)
def test_real_logs(name: str, least_frames: int, most_dropped: int) -> None:
    reader = TlogReader(TELEMETRY / name)
    stamps_us = [stamp_us for stamp_us, _ in reader]
    assert reader.frames == len(stamps_us) > least_frames and reader.dropped_bytes < most_dropped
    assert stamps_us[-1] - stamps_us[0] < 7_200e6
