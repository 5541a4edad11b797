"""Limits that follow the board: what a small and a large one get, and that the unit says it."""

import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.commands.cli import app
from service.commands.install.board_limits import Board, cpu_quota_percent, limited, memory_max_mb, read_board
from service.commands.install.install import DROP_INS, SOURCES, UNIT, install, uninstall
from service.commands.install.unit_environment import unit_environment
from tests.support.places import HANG_S, ROOT


@pytest.mark.parametrize(
    ("board", "quota", "most_mb", "with_gpu_mb"),
    [
        (Board(1, 430), 90, 320, 1024),  # a Pi Zero
        (Board(4, 920), 300, 460, 1024),
        (Board(4, 3800), 300, 1024, 2280),  # a Pi 4
        (Board(6, 7600), 500, 1024, 4560),  # an Orin Nano
        (Board(12, 62000), 1100, 1024, 6144),
        (Board(2, 4000), 150, 1024, 2400),
    ],
)
def test_limits_of_boards(board: Board, quota: int, most_mb: int, with_gpu_mb: int) -> None:
    assert cpu_quota_percent(board) == quota
    assert memory_max_mb(board, has_gpu=False) == most_mb and memory_max_mb(board, has_gpu=True) == with_gpu_mb


def test_the_unit_and_the_jetsons_drop_in_say_them(tmp_path: Path) -> None:
    said: list[str] = []
    install(tmp_path, "/opt/distloc/bin/distloc", True, said.append, ("jetson", "pi"), Board(6, 7600))
    assert "limits for 6 cores and 7600 MB of memory" in said
    unit, jetson = (tmp_path / UNIT).read_text(), (tmp_path / DROP_INS["jetson"]).read_text()
    assert "\nCPUQuota=500%\nMemoryHigh=768M\nMemoryMax=1024M\n" in unit
    assert "\nMemoryHigh=3420M\nMemoryMax=4560M\n" in jetson and "OOMPolicy=continue" in jetson
    assert (tmp_path / DROP_INS["pi"]).read_bytes() == (SOURCES / "distloc.service.d/pi.conf").read_bytes()
    uninstall(tmp_path, True, True, said.append)
    assert list(tmp_path.rglob("*.conf")) == []


def test_only_limits_are_changed() -> None:
    shipped = (SOURCES / "distloc.service").read_bytes()
    changed = limited(shipped, Board(6, 400), has_gpu=False)
    differing = {line.split(b"=")[0] for line in set(shipped.splitlines()) ^ set(changed.splitlines())}
    assert differing == {b"CPUQuota", b"MemoryHigh", b"MemoryMax"}


def test_an_image_gets_the_shipped_limits(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["install", "--root", str(tmp_path), "--exec", "/opt/d/distloc", "--pi", "--yes"])
    assert done.exit_code == 0 and "limits for" not in done.stdout
    assert "CPUQuota=300%" in (tmp_path / UNIT).read_text() and (tmp_path / DROP_INS["pi"]).exists()


def test_this_board_and_one_that_does_not_say(tmp_path: Path) -> None:
    board = read_board()
    assert board is not None and board.cores >= 1 and board.memory_mb > 100
    (tmp_path / "meminfo").write_text("MemFree: 5 kB\n")
    assert read_board(tmp_path / "meminfo") is None and read_board(tmp_path / "none") is None


def test_the_container_has_the_units_environment() -> None:
    text = (ROOT / "Containerfile").read_text()
    assert {f"{name}={value}" for name, value in unit_environment().items()} <= set(text.split())
    let_in = (ROOT / ".dockerignore").read_text()
    assert all(f"!{name}\n" in let_in for name in ("distloc", "service", "systemd", "pyproject.toml", "README.md"))


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_takes_both_drop_ins(tmp_path: Path) -> None:
    executable = shutil.which("env") or "/usr/bin/env"
    install(tmp_path, executable, True, lambda _: None, ("jetson", "pi"), Board(4, 3800))
    verify = ["systemd-analyze", "verify", str(tmp_path / UNIT)]
    done = subprocess.run(verify, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
