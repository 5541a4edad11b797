"""The ground station as a process: what it prints, and what a full disk, a closed pipe and foul keys do to it."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import msgspec
import pytest

from service.config.sections import ZenohConfig
from service.ground.report_file import ReportFile
from service.ground.subscriber import line_from_report
from service.publish.wire import StatusReport, encode, report_from_target
from service.publish.zenoh import ZenohPublisher
from tests.support.places import HANG_S
from tests.support.ports import free_port
from tests.support.wire_samples import located

REPORT = encode(report_from_target(located(), "drone1"))
STATUS = msgspec.json.encode(StatusReport(vehicle="drone1", time_utc=None, state="degraded", degraded=["clock"]))


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@contextlib.contextmanager
def station(
    endpoint: str, *arguments: str, stdout: IO[bytes] | int = subprocess.PIPE
) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "service.ground.station", "--connect", endpoint, *arguments]
    process = subprocess.Popen(command, stdout=stdout, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=HANG_S)


def line_with(stream: IO[str] | None, words: str) -> list[str]:
    """The lines up to the first that has these words; the process's end ends them."""
    assert stream is not None
    lines: list[str] = []
    for line in stream:
        lines.append(line.rstrip("\n"))
        if words in line:
            return lines
    raise AssertionError(f"{words!r} did not come after {lines}")


def test_it_says_who_is_there_how_they_are_and_when_they_are_gone(endpoint: str) -> None:
    with station(endpoint) as ground:
        line_with(ground.stderr, f"not connected to {endpoint}")
        with ZenohPublisher(ZenohConfig(listen=(endpoint,)), "drone1") as publisher:
            publisher.publish_status(STATUS)
            publisher.publish_report(3, REPORT)
            assert line_with(ground.stdout, "targets/3") == [line_from_report("distloc/drone1/targets/3", REPORT)]
            heard = line_with(ground.stderr, "drone1 is there")
            if not any("degraded" in line for line in heard):
                publisher.publish_status(STATUS)
                heard += line_with(ground.stderr, "drone1 degraded: clock (no TIMESYNC reply")
            if not any(f"connected to {endpoint}" in line for line in heard):
                line_with(ground.stderr, f"distloc: connected to {endpoint}")
        line_with(ground.stderr, "drone1 is gone")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a Linux device")
def test_a_full_disk_under_out_is_a_line_and_printing_goes_on(endpoint: str) -> None:
    with ZenohPublisher(ZenohConfig(listen=(endpoint,)), "drone1") as publisher:
        publisher.publish_report(3, REPORT)
        with station(endpoint, "--out", "/dev/full") as ground:
            line_with(ground.stdout, "targets/3")
            assert line_with(ground.stderr, "No space left")[-1].endswith("reports are only printed")
            publisher.publish_report(4, REPORT)
            line_with(ground.stdout, "targets/4")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a Linux device")
def test_a_stdout_that_takes_no_more_ends_it_with_a_line(endpoint: str) -> None:
    with ZenohPublisher(ZenohConfig(listen=(endpoint,)), "drone1") as publisher:
        publisher.publish_report(3, REPORT)
        with open("/dev/full", "wb") as full, station(endpoint, stdout=full) as ground:
            assert ground.wait(60) == 1
            assert "Traceback" not in "".join(line_with(ground.stderr, "distloc: stdout: No space left"))
        reading, writing = os.pipe()
        os.close(reading)
        with os.fdopen(writing, "wb") as closed, station(endpoint, stdout=closed) as ground:
            assert ground.wait(60) == 1
            assert "Traceback" not in "".join(line_with(ground.stderr, "distloc: stdout: Broken pipe"))


def test_an_out_that_cannot_be_opened_is_one_line(endpoint: str, tmp_path: Path) -> None:
    with station(endpoint, "--out", str(tmp_path / "none" / "a")) as ground:
        assert ground.wait(60) == 1
        assert ground.stderr is not None and ground.stderr.read().splitlines() == [
            f"distloc: --out {tmp_path}/none/a: No such file or directory"
        ]


@pytest.mark.parametrize(
    ("key", "payload"),
    [
        ("distloc/x\r\x1b[2Kdistloc: drone1 no fire\n\x1b]0;t\x07/targets/1", b"{}"),
        ("distloc/x\ndistloc/drone1/targets/1 confirmed/targets/1", REPORT),
        ("k", json.dumps(json.loads(REPORT) | {"properties": {"state": "\x1b[2J"}}).encode()),
        ("k", REPORT.replace(b'"confirmed"', rb'"\u001b[2J"')),
        ("k", b'{"type":"\xff\xfe\x1b[31m'),
        ("k", b'{"a":' * 200_000),
        ("k", b'{"type":"Feature","x":"' + b"\x1b" * 2_000_000 + b'"}'),
        ("k" * 100_000, b"{}"),
    ],
)
def test_foul_keys_and_payloads_are_one_short_printable_line(key: str, payload: bytes) -> None:
    line = line_from_report(key, payload)
    assert line.isprintable() and len(line) < 1200


def test_a_file_has_whole_lines_or_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "reports.jsonl"
    with ReportFile(path) as out:
        assert out.append(b"1") is False
        file = out._file

        class Full:
            """Takes two bytes, then the disk is full."""

            def fileno(self) -> int:
                return file.fileno()

            def write(self, data: bytes) -> int:
                return file.write(data[:2])

            def close(self) -> None:
                file.close()

        monkeypatch.setattr(out, "_file", Full())
        assert out.append(b"22222") is True and out.fault is not None
        assert out.append(b"22222") is False
        monkeypatch.setattr(out, "_file", file)
        assert out.append(b"333") is True and out.fault is None
    assert out.append(b"4") is False and out.fault is None  # one of zenoh's threads may come late
    assert path.read_bytes() == b"1\n333\n"
