"""What is recorded: on the disk before it is told so, whole lines after a kill, bounded; and its replay."""

import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.commands.cli import app
from service.ground.faults import GroundError
from service.ground.inbox import Heard
from service.ground.record.recorder import MOST_WAITING, Foreign, Recorder, read
from service.ground.record.replayed import Replayed
from service.ground.record.review import review
from tests.support.ground_samples import NOW_S, heard, report_bytes
from tests.support.places import HANG_S, ROOT

DAY_S = 86_400.0


def test_what_is_recorded_comes_back_as_it_came(tmp_path: Path) -> None:
    messages = [
        heard("drone1/alive", b"", NOW_S),
        heard("drone1/targets/3", report_bytes().replace(b",", b",\n "), NOW_S + 1.0),  # on one line all the same
        heard("drone1/alive", None, NOW_S + 2.0),
        heard("drone1/alive", b"", NOW_S + DAY_S),
    ]
    with Recorder(tmp_path, 1_000_000) as recorder:
        for one in messages:
            recorder.append(one)
    first, second = sorted(tmp_path.glob("*.jsonl"))
    assert (first.name, second.name) == ("ground-2027-01-15.jsonl", "ground-2027-01-16.jsonl")
    back = [*read(first), *read(second)]
    assert [one.key for one in back] == [one.key for one in messages]
    assert back[1].payload == report_bytes() and back[1].arrived_s == NOW_S + 1.0
    assert [one.payload for one in (back[0], back[2])] == [b"", None]
    assert recorder.recorded_s == NOW_S + DAY_S and not recorder.fault


def test_nothing_that_was_told_as_recorded_is_lost_by_a_kill(tmp_path: Path) -> None:
    code = textwrap.dedent("""
        import os, signal, sys
        from pathlib import Path
        from service.ground.record.recorder import Recorder
        from tests.support.ground_samples import heard, report_bytes
        recorder = Recorder(Path(sys.argv[1]), 10**9)
        recorder.__enter__()
        number = told = 0
        while told < 300:
            number += 1
            recorder.append(heard(f"drone1/targets/{number}", report_bytes(number), float(number)))
            told = recorder.recorded_s or 0
        print(int(told), flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    """)
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    told = int(done.stdout)
    (path,) = tmp_path.glob("*.jsonl")
    assert [one.arrived_s for one in read(path)][:told] == [float(one) for one in range(1, told + 1)]


def test_half_a_line_is_passed_over_and_what_follows_is_not(tmp_path: Path) -> None:
    with Recorder(tmp_path, 1_000_000) as recorder:
        recorder.append(heard("drone1/targets/1", report_bytes(1)))
    (path,) = tmp_path.glob("*.jsonl")
    whole = path.read_bytes()
    path.write_bytes(whole + whole[: len(whole) // 2])
    with Recorder(tmp_path, 1_000_000) as recorder:
        recorder.append(heard("drone1/targets/2", report_bytes(2)))
    assert [one.key for one in read(path)] == ["distloc/drone1/targets/1", "distloc/drone1/targets/2"]


def test_the_record_is_bounded_the_oldest_day_goes_and_a_full_day_is_a_fault(tmp_path: Path) -> None:
    line = len(report_bytes()) + 100
    with Recorder(tmp_path, 10 * line) as recorder:
        for day in range(4):
            for _ in range(4):
                recorder.append(heard("drone1/targets/3", report_bytes(), NOW_S + day * DAY_S))
    assert sum(one.stat().st_size for one in tmp_path.glob("*.jsonl")) <= 10 * line
    assert sorted(tmp_path.glob("*.jsonl"))[-1].name == "ground-2027-01-18.jsonl"
    with Recorder(tmp_path, line) as recorder:
        recorder.append(heard("drone1/targets/3", report_bytes(), NOW_S + 9 * DAY_S))
        recorder.append(heard("drone1/targets/3", report_bytes(), NOW_S + 9 * DAY_S))
    assert "the record may take" in recorder.fault


def test_a_disk_that_fails_is_told_and_nothing_counts_as_recorded(tmp_path: Path) -> None:
    def failing(_handle: int) -> None:
        raise OSError(5, "Input/output error")

    with Recorder(tmp_path, 1_000_000, failing) as recorder:
        recorder.append(heard("drone1/targets/3", report_bytes()))
    assert (recorder.recorded_s, recorder.fault) == (None, "Input/output error")
    (path,) = tmp_path.glob("*.jsonl")
    assert path.read_bytes() == b""


def test_what_arrived_together_is_told_as_recorded_together(tmp_path: Path) -> None:
    """The inbox gives messages by drone, so the first of them may be the newest."""
    at_s: list[float | None] = []

    def slow(_handle: int) -> None:
        at_s.append(recorder.recorded_s)

    newest = heard("drone1/targets/1", report_bytes(1), NOW_S + 0.09)
    older = [heard(f"drone2/targets/{number}", report_bytes(number, "drone2"), NOW_S) for number in range(50)]
    with Recorder(tmp_path, 1_000_000, slow) as recorder:
        recorder.extend([newest, *older])
    (path,) = tmp_path.glob("*.jsonl")
    assert len(list(read(path))) == 51 and recorder.recorded_s == newest.arrived_s
    assert at_s == [None]  # and on the disk in one go


@pytest.mark.parametrize("payload", [b"{", b"\xff", b"{} {}", b"[" * 50_000])
def test_what_is_no_json_does_not_end_the_record(tmp_path: Path, payload: bytes) -> None:
    with Recorder(tmp_path, 1_000_000) as recorder:
        recorder.extend([heard("drone1/marks/1", payload), heard("drone1/targets/3", report_bytes())])
    (path,) = tmp_path.glob("*.jsonl")
    assert [one.key for one in read(path)] == ["distloc/drone1/targets/3"]
    assert (recorder.fault, recorder.recorded_s) == ("", NOW_S)


def test_a_folder_that_went_away_is_a_fault_and_nothing_counts_as_recorded_there(tmp_path: Path) -> None:
    folder, away = tmp_path / "stick", tmp_path / "pulled"
    folder.mkdir()
    written = threading.Event()
    with Recorder(folder, 1_000_000, lambda _: written.set()) as recorder:
        recorder.append(heard("drone1/targets/1", report_bytes(1), NOW_S))
        assert written.wait(HANG_S)
        end_s = time.monotonic() + HANG_S
        while recorder.recorded_s is None and time.monotonic() < end_s:
            time.sleep(0.001)  # it looks at the folder once more after the sync
        folder.rename(away)
        recorder.append(heard("drone1/targets/2", report_bytes(2), NOW_S + 1.0))
    assert (recorder.fault, recorder.recorded_s) == ("No such file or directory", NOW_S)


def test_what_a_disk_did_not_take_for_long_is_counted(tmp_path: Path) -> None:
    def failing(_handle: int) -> None:
        raise OSError(5, "Input/output error")

    messages = [heard("drone1/targets/3", b"{}", NOW_S + number) for number in range(MOST_WAITING + 7)]
    with Recorder(tmp_path, 100_000_000, failing) as recorder:
        recorder.extend(messages[:9])
        recorder.extend(messages[9:])
    assert (recorder.lost, recorder.recorded_s) == (7, None)


def recorded(folder: Path, *times_s: float) -> Path:
    with Recorder(folder, 1_000_000) as recorder:
        for one in times_s:
            recorder.append(heard("drone1/targets/3", report_bytes(at_s=one), one))
    (path,) = folder.glob("*.jsonl")
    return path


def played(path: Path, speed: float) -> tuple[Replayed, Callable[[float], list[Heard]]]:
    now = [0.0]
    replayed = Replayed(path, speed, lambda: now[0])

    def after(seconds: float) -> list[Heard]:
        now[0] += seconds
        return replayed.due()

    return replayed, after


def test_a_replay_keeps_the_records_times_at_its_speed_and_leaves_out_its_gaps(tmp_path: Path) -> None:
    path = recorded(tmp_path, NOW_S, NOW_S + 4.0, NOW_S + 5000.0)
    replayed, after = played(path, 4.0)
    assert [one.arrived_s for one in after(0.0)] == [NOW_S] and replayed.now_s == NOW_S
    assert after(0.5) == [] and [one.arrived_s for one in after(0.5)] == [NOW_S + 4.0]
    assert [one.arrived_s for one in after(0.1)] == [NOW_S + 5000.0]
    assert replayed.is_over and after(100.0) == [] and replayed.now_s == NOW_S + 5000.0


def test_a_replay_says_by_how_much_the_grounds_clock_was_set_back(tmp_path: Path) -> None:
    path = recorded(tmp_path, NOW_S, NOW_S + 1.0, NOW_S - 3599.0, NOW_S - 3598.0)
    replayed, after = played(path, 1.0)
    after(0.0)
    assert [one.arrived_s for one in after(1.0)] == [NOW_S + 1.0] and replayed.set_back_s == 0.0
    assert [one.arrived_s for one in after(0.0)] == [NOW_S - 3599.0] and replayed.set_back_s == -3600.0
    assert [one.arrived_s for one in after(1.0)] == [NOW_S - 3598.0] and replayed.set_back_s == 0.0


def test_a_file_that_is_no_record_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "other.jsonl"
    path.write_text('{"a": 1}\n' + "[" * 100_000)
    with pytest.raises(GroundError, match=r"other\.jsonl: holds no message"):
        Replayed(path, 1.0)


@pytest.mark.parametrize("time_s", ["1e300", "1e14", "-1e18", "1e999", "-1", "32503680001", '"x"'])
def test_a_line_of_no_time_is_passed_over_and_counted(tmp_path: Path, time_s: str) -> None:
    with Recorder(tmp_path, 1_000_000) as recorder:
        recorder.append(heard("drone1/targets/3", report_bytes(3), NOW_S))
    (path,) = tmp_path.glob("*.jsonl")
    good = path.read_text()
    bad = good.replace(good[: good.index(",")], f'{{"t":{time_s}')
    path.write_text(good + bad + good + bad)
    foreign = Foreign()
    page = review(read(path, foreign), "a mission").decode()
    assert "drone1/3" in page and foreign == Foreign(2, 2)
    assert [one.arrived_s for one in read(path)] == [NOW_S, NOW_S]
    out = CliRunner().invoke(app, ["ground", "--replay", str(path), "--export", str(tmp_path / "m.html")])
    said = f"{path}: left out what is no line of a record: 2, the first of them line 2"
    assert (out.exit_code, out.output.splitlines()) == (0, [said, f"wrote {tmp_path / 'm.html'}"])
