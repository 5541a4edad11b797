"""A run of a command ends whole, however it ends, and says how."""

import os
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from service.camera.command.run import Ended, Run
from tests.support.frame_writer import raw_frame, writer
from tests.support.places import HANG_S, ROOT


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """However slow the machine is, an end is noticed."""
    monkeypatch.setattr("service.camera.command.run._NOTICE_S", HANG_S)


def read_all(run: Run) -> bytes:
    """What it writes until it closes its standard output."""
    data = b""
    poll = select.poll()
    poll.register(run.frames, select.POLLIN)
    while poll.poll(HANG_S * 1000):
        more = os.read(run.frames, 1 << 20)
        if not more:
            break
        data += more
    return data


def ran(*verbs: str) -> tuple[bytes, Ended]:
    run = Run(writer(*verbs), False)
    try:
        return read_all(run), run.end(has_ended=True)
    except BaseException:
        run.end()
        raise


def pid_in(path: Path) -> int:
    until(path.exists)
    return int(path.read_text())


def until(condition: object) -> None:
    end_s = time.monotonic() + HANG_S
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end_s
        time.sleep(0.005)


def is_alive(pid: int) -> bool:
    """Whether a process is there that is no zombie, which waits for whoever adopted it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def descriptors() -> set[str]:
    return set(os.listdir("/proc/self/fd"))


def test_its_output_is_ours_and_its_end_is_told() -> None:
    assert ran("frames 2", "say oh no", "exit 3") == (
        raw_frame(1) + raw_frame(2),
        Ended("ended with status 3", "oh no"),
    )


def test_the_last_words_are_the_last() -> None:
    _, ended = ran(*(f"say word {number} {'y' * 100}" for number in range(100)), "die")
    assert ended.why == "ended by SIGKILL" and ended.words.startswith("word 97") and "word 99" in ended.words
    assert len(ended.words) <= 400


@pytest.mark.parametrize(
    ("program", "why"),
    [("/no/such/program", "No such file or directory"), (str(ROOT / "README.md"), "Permission denied")],
)
def test_one_that_cannot_be_started(program: str, why: str) -> None:
    run = Run((program,), False)
    assert read_all(run) == b""
    assert run.end(True) == Ended(f"cannot be started: {why}", is_started=False)


def test_nothing_but_its_own_descriptors_is_open_in_it() -> None:
    reading, writing = os.pipe()
    os.set_inheritable(writing, True)
    run = Run((sys.executable, "-I", "-c", "import os; print(sorted(os.listdir('/proc/self/fd')))"), True)
    said = read_all(run)
    run.end()
    os.close(reading)
    os.close(writing)
    assert said == b"['0', '1', '2', '3', '4']\n"  # 4: the listing itself


def test_the_times_come_on_descriptor_3() -> None:
    run = Run(writer("line 12.5", "exit 0"), True)
    read_all(run)
    assert run.times is not None and os.read(run.times, 100) == b"12.5\n"
    run.end()


def test_a_flood_of_words_is_drained_and_told() -> None:
    data, ended = ran("flood 3", "frames 1")
    assert data == raw_frame(1) and ended.is_flood and len(ended.words) <= 400


def test_what_it_leaves_behind_is_ended(tmp_path: Path) -> None:
    path = tmp_path / "pid"
    run = Run(writer(f"leave {path}", "frames 1"), False)
    left = pid_in(path)
    assert read_all(run) == raw_frame(1)  # though the one that is left holds the pipe
    assert run.end(True) == Ended("ended with status 0 and left 1 process behind, ended too")
    assert not is_alive(left)


@pytest.mark.parametrize("deaf", [(), ("deaf",)])
def test_it_is_ended_with_all_that_came_of_it(tmp_path: Path, deaf: tuple[str, ...]) -> None:
    before = descriptors()
    paths = tmp_path / "left", tmp_path / "itself"
    run = Run(writer(*deaf, f"leave {paths[0]}", f"pid {paths[1]}", "sleep"), False)
    pids = [pid_in(path) for path in paths]
    assert all(is_alive(pid) for pid in pids)
    run.end()
    assert not any(is_alive(pid) for pid in pids)
    assert descriptors() == before


def test_where_the_keeper_is_killed_all_that_came_of_it_is_found_and_ended(tmp_path: Path) -> None:
    paths = tmp_path / "left", tmp_path / "itself"
    run, other = (Run(writer(f"leave {path}", f"pid {path}.self", "sleep"), False) for path in paths)
    pids = [pid_in(path) for path in (paths[0], Path(f"{paths[0]}.self"))]
    others = [pid_in(path) for path in (paths[1], Path(f"{paths[1]}.self"))]
    os.kill(run._keeper.pid, signal.SIGKILL)
    assert run.end(has_ended=True).why.startswith("was lost: ")
    assert not any(is_alive(pid) for pid in pids) and all(is_alive(pid) for pid in others)
    other.end()


def test_again_and_again_leaves_nothing() -> None:
    ran("exit 0")
    before, threads = descriptors(), threading.active_count()
    for number in range(20):
        assert ran("frames 1", "say x", f"exit {number}")[1].why == f"ended with status {number}"
    assert descriptors() == before and threading.active_count() == threads


SERVICE = """
import os, sys, time
from service.camera.command.run import Run
run = Run(tuple(sys.argv[1:]), True)
print(run._keeper.pid, flush=True)
time.sleep(1000)
"""


@pytest.mark.parametrize("whose", ["service", "keeper"])
def test_a_kill_leaves_nothing(tmp_path: Path, whose: str) -> None:
    """Of the service: all of it goes. Of the keeper: the command itself does at once; what left it, `Run.end` ends."""
    paths = tmp_path / "itself", tmp_path / "left"
    verbs = ["deaf", f"pid {paths[0]}", *([f"leave {paths[1]}"] if whose == "service" else []), "sleep"]
    command = [sys.executable, "-c", SERVICE, *writer(*verbs)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as service:
        assert service.stdout is not None
        keeper = int(service.stdout.readline())
        pids = [keeper, *(pid_in(path) for path in paths[: 2 if whose == "service" else 1])]
        os.kill(service.pid if whose == "service" else keeper, signal.SIGKILL)
        for pid in pids:
            until(lambda pid=pid: not is_alive(pid))
        service.kill()
