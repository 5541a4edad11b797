"""A short real soak with faults, end to end; Ctrl-C; and that no process outlives the one that started it."""

import csv
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from service.commands.errors import MissingExtraError
from service.commands.soak import command
from service.commands.soak.command import run_soak
from service.commands.soak.flight import Settings
from service.commands.soak.judging.result import SoakResult
from service.commands.soak.judging.series import COLUMNS
from service.commands.soak.schedule import Pace
from service.config.sections import SegmenterConfig
from tests.support.places import HANG_S, ROOT

MODULES = ("service.commands.soak.renderer", "service.commands.soak.served")


def is_starved(result: SoakResult) -> bool:
    """Whether the machine is so busy that the camera gave few of its frames: it is lost, then."""
    return result.counts.frames_sent < 0.8 * result.counts.frames_wanted


def wait_for(condition: Callable[[], object], what: str) -> None:
    until_s = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < until_s, what
        time.sleep(0.05)


def running(parent: int) -> dict[int, str]:
    """The soak's children of a process, by pid; those that have ended are not among them."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text().rpartition(")")[2].split()
            said = (folder / "cmdline").read_text()
        except OSError:
            continue
        module = next((module for module in MODULES if module in said), "")
        if stat[1] == str(parent) and stat[0] != "Z" and module:
            found[int(folder.name)] = module
    return found


def is_alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SoakResult]:
    out = tmp_path_factory.mktemp("soak")
    settings = Settings(
        minutes=1.0,
        segmenter=SegmenterConfig(kind="classical"),
        n_particles=20_000,
        pace=Pace(every_s=15.0, warm_s=26.0, rest_s=10.0, lasting_s=(4.0, 4.5)),
        kinds=("autopilot silent", "camera frozen"),
    )
    return out, run_soak(out, settings, lambda line: None)


@pytest.mark.thorough
def test_the_service_lives_and_works(flown: tuple[Path, SoakResult]) -> None:
    out, result = flown
    assert msgspec.json.decode((out / "soak.json").read_bytes(), type=SoakResult) == result
    assert 1.0 <= result.minutes < 1.0 + HANG_S / 60.0  # a busy machine comes late to its end
    assert (result.life.crashes, result.life.watchdog_misses) == (0, 0)
    assert 0.1 < result.life.ready_s < HANG_S
    counts = result.counts
    assert counts.frames_wanted == pytest.approx(600 * result.minutes, abs=10)
    assert 20 < counts.frames_sent <= counts.frames_wanted + 2  # fewer where the machine is busy
    assert 10 < counts.frames_localised < counts.frames_sent, "each fault takes four seconds of frames"
    assert 0 < counts.messages_sent < 1.15 * 200 * (60 * result.minutes - 4)
    assert 0.0 < counts.messages_used < 0.6 * counts.messages_sent
    assert counts.reports > 5 and counts.reports_unmatched <= 0.2 * counts.reports
    assert counts.targets == len(result.targets)
    assert counts.targets >= 1 or is_starved(result)
    assert counts.targets_false == 0


@pytest.mark.thorough
def test_what_is_measured_can_be(flown: tuple[Path, SoakResult]) -> None:
    memory, cpu, latency = flown[1].memory, flown[1].cpu, flown[1].latency
    assert 60.0 < memory.start_mb <= memory.peak_mb < 400.0 and memory.end_mb <= memory.peak_mb
    assert memory.at_5_min_mb is None and memory.slope_from_s == pytest.approx(10.0 * flown[1].minutes, abs=1.0)
    assert 0.03 < cpu.mean <= cpu.p95 < 2.0
    assert latency.p50_ms is not None and latency.p95_ms is not None and latency.max_ms is not None
    assert 5.0 < latency.p50_ms <= latency.p95_ms <= latency.max_ms + 1.0 < HANG_S * 1e3


@pytest.mark.thorough
def test_faults_come_show_and_pass(flown: tuple[Path, SoakResult]) -> None:
    faults = {fault.kind: fault for fault in flown[1].faults}
    assert set(faults) == {"autopilot silent", "camera frozen"}
    assert "link" in faults["autopilot silent"].degraded
    frozen = {"camera_frozen", "camera"} if is_starved(flown[1]) else {"camera_frozen"}
    assert frozen & set(faults["camera frozen"].degraded)
    for fault in faults.values():
        assert 3.5 < fault.end_s - fault.start_s < HANG_S
        assert fault.recovered_s is not None or is_starved(flown[1])


@pytest.mark.thorough
def test_the_series_and_the_picture(flown: tuple[Path, SoakResult]) -> None:
    out, result = flown
    with (out / "soak.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS and 5 <= len(rows) <= 60 * result.minutes
    assert max(float(row["peak_mb"]) for row in rows) == pytest.approx(result.memory.peak_mb, abs=0.1)
    assert sum(bool(row["latency_p50_ms"]) for row in rows) == len(rows) // 10
    silent = next(fault for fault in result.faults if fault.kind == "autopilot silent")
    # a row tells of the time since the one before, which may be long; a fault's times are rounded to 10 ms
    inside = [
        row
        for before, row in pairwise(rows)
        if silent.start_s + 0.5 < float(before["t_s"]) and float(row["t_s"]) < silent.end_s - 0.01
    ]
    assert inside and all(float(row["messages_hz"]) == 0.0 for row in inside)
    picture = cv2.imread(str(out / "soak.png"))
    assert picture is not None and min(picture.shape[:2]) > 1000 and np.ptp(picture) > 200
    left = {path.name for path in out.iterdir()}
    assert left == {"soak.json", "soak.csv", "soak.png", "service.log", "renderer.log"}


def started(out: Path) -> tuple["subprocess.Popen[str]", dict[int, str]]:
    """The command, once its service is ready; and its children."""
    arguments = ["soak", "--minutes", "1", "--segmenter", "classical", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "service", *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    log = out / "service.log"
    wait_for(lambda: log.exists() and "ready" in log.read_text(), "the service is ready")
    return process, running(process.pid)


def await_seconds(out: Path) -> None:
    """Until some seconds are flown, as the recording tells, which grows by 8 kB in each."""
    logs = ".flight-*/recording/flight-*/telemetry.tlog"
    wait_for(lambda: any(log.stat().st_size > 30_000 for log in out.glob(logs)), "some seconds are flown")


def test_no_child_outlives_a_parent_that_is_killed(tmp_path: Path) -> None:
    process, children = started(tmp_path)
    assert sorted(children.values()) == sorted(MODULES)
    process.kill()
    process.communicate()
    wait_for(lambda: not any(map(is_alive, children)), f"ended: {children}")


def test_ctrl_c_ends_it_early_with_its_files(tmp_path: Path) -> None:
    process, children = started(tmp_path)
    await_seconds(tmp_path)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=HANG_S)
    assert "Traceback" not in errors
    assert not any(map(is_alive, children))
    result = msgspec.json.decode((tmp_path / "soak.json").read_bytes(), type=SoakResult)
    assert 0.0 < result.minutes < 1.1 and result.minutes_wanted == 1.0 and result.life.crashes == 0
    assert process.returncode == int(not result.verdict.passed)
    assert f"soak {'passed' if result.verdict.passed else 'failed'} after" in output


def test_a_service_that_dies_fails_the_soak(tmp_path: Path) -> None:
    process, children = started(tmp_path)
    await_seconds(tmp_path)
    os.kill(next(pid for pid, module in children.items() if module == "service.commands.soak.served"), signal.SIGKILL)
    output, errors = process.communicate(timeout=HANG_S)
    assert "Traceback" not in errors and "FAIL crashes: 1 (limit 0)" in output
    assert process.returncode == 1 and (tmp_path / "soak.json").exists()
    assert not any(map(is_alive, children))


@pytest.mark.thorough
def test_without_matplotlib_the_rest_is_written(
    flown: tuple[Path, SoakResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> None:
        raise MissingExtraError("no matplotlib")

    said: list[str] = []
    monkeypatch.setattr(command, "load_plots", missing)
    from service.commands.soak.judging.series import Series

    command._write(tmp_path, flown[1], Series(1), said.append)
    assert {path.name for path in tmp_path.iterdir()} == {"soak.json", "soak.csv"}
    assert "pip install '.[study]'" in said[0]


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--minutes", "0"], 2, "--minutes"),
        (["--minutes", "1", "--speed", "11"], 2, "--speed"),
        (["--minutes", "1", "--out", "/dev/null"], 1, "--out /dev/null: must be a folder that can be written"),
    ],
)
def test_bad_input_is_told_in_a_line(arguments: list[str], code: int, said: str) -> None:
    command_line = [sys.executable, "-m", "service", "soak", *arguments]
    done = subprocess.run(command_line, cwd=ROOT, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == code and said in done.stderr and "Traceback" not in done.stderr
