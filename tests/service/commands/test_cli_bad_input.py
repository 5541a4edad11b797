"""What the command line says of bad input: one line on stderr, the right exit code, nothing half-written."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.commands.cli import main
from tests.support.places import HANG_S

QUIET = "[zenoh]\nenabled = false\n"


@pytest.fixture
def used_port() -> Iterator[int]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        yield other.getsockname()[1]


def fails(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: str) -> tuple[int, str]:
    """The exit code, and the one line on stderr."""
    monkeypatch.setattr(sys, "argv", ["distloc", *arguments])
    with pytest.raises(SystemExit) as exit_:
        main()
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("distloc: ")
    return int(exit_.value.code or 0), lines[0]


@pytest.mark.parametrize(
    ("text", "code", "names"),
    [
        ("bogus = 1", 78, "bogus"),
        ("[camera]\nwidth = 2", 78, "camera.width"),
        ("[camera]\nfx = nan", 78, "camera.fx"),
        ("[camera]\ndistortion = [1.0, 2.0]", 78, "distortion"),
        ("[camera", 78, "not TOML"),
        ("[localizer]\nrange_m = [5.0, 1.0]", 78, "localizer.range_m"),
        ('[segmenter]\nkind = "onnx"\nmodel = "nope.onnx"', 78, "nope.onnx"),
        ('[segmenter]\nkind = "recorded"', 78, "segmenter.kind"),
        ('[recorder]\nfolder = "a\\u0000b"', 78, "recorder.folder holds a NUL"),
        ('[[mavlink.links]]\nurl = "serial:/dev/tty\\u0000:57600"', 78, "mavlink.links.url holds a NUL"),
        (f'[recorder]\nfolder = "{"x" * 5000}"', 78, "recorder.folder is 'xxx"),
        (f'[state]\ndir = "/{"x" * 300}"', 78, "state.dir is '/xxx"),
        (f'[ground]\nkind = "dem"\npath = "{"x" * 300}"', 78, "ground.path is 'xxx"),
        (f'[segmenter]\nkind = "onnx"\nmodel = "{"x" * 300}"', 78, "segmenter.model is 'xxx"),
        (f'[camera.source]\nkind = "video"\npath = "{"x" * 300}"', 78, "camera.source.path is 'xxx"),
        ('[[mavlink.links]]\nurl = "udpin:a..b:14550"', 78, "'a..b' is no host's name"),
        ("[localizer]\nn_particles = 10000001", 78, "localizer.n_particles"),
        ("[camera]\nwidth = 1280\nheight = 720", 78, "camera.width, camera.height are 1280 x 720"),
        ("[camera.mount]\nforward_m = 1e300", 78, "camera.mount.forward_m"),
        ("[camera.source]\nlatency_ms = 1e300", 78, "camera.source.latency_ms"),
        ("[mavlink]\nattitude_hz = 1e300", 78, "mavlink.attitude_hz"),
        ("[mavlink]\nposition_hz = 0.001", 78, "mavlink.position_hz"),
        ("\n".join(['[[mavlink.links]]\nurl = "udpin:127.0.0.1:0"'] * 17), 78, "mavlink.links is"),
        ('[camera.source]\nkind = "video"\npath = "nope.mp4"', 1, "nope.mp4"),
        ('[camera.source]\nkind = "folder"\npath = "nope"', 1, "nope"),
    ],
)
def test_run_refuses(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    text: str,
    code: int,
    names: str,
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(f"{text}\n{QUIET}")
    got, line = fails(capfd, monkeypatch, "run", "--config", str(config))
    assert got == code
    assert names in line


def test_run_names_a_port_in_use(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, used_port: int
) -> None:
    config = tmp_path / "config.toml"
    config.write_text(f'{QUIET}[[mavlink.links]]\nurl = "udpin:127.0.0.1:{used_port}"\n')
    code, line = fails(capfd, monkeypatch, "run", "--config", str(config))
    assert code == 1
    assert str(used_port) in line
    assert "in use" in line


def test_replay_refuses_what_is_no_recording(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "zero.tlog").touch()
    out = tmp_path / "out"
    for name in ("missing", "empty", "zero.tlog"):
        code, line = fails(capfd, monkeypatch, "replay", str(tmp_path / name), "--out", str(out))
        assert code == 1
        assert name in line
    assert not out.exists()


def test_simulate_leaves_what_exists(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "kept").write_text("mine")
    code, line = fails(capfd, monkeypatch, "simulate", str(tmp_path))
    assert code == 1
    assert "not an empty folder" in line
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]


def test_usage_is_2() -> None:
    done = subprocess.run([sys.executable, "-m", "service", "frobnicate"], capture_output=True, check=False)
    assert done.returncode == 2
    assert b"Traceback" not in done.stderr


def test_sigterm_stops_a_run_without_links(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text(QUIET)
    command = [sys.executable, "-m", "service", "run", "--config", str(config)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        ready = next(line for line in process.stderr if "ready" in line)
        assert "no link; segmenter onnx smoke-seg " in ready
        os.kill(process.pid, signal.SIGTERM)
        rest = process.stderr.read()
        assert process.wait(5) == 0
    assert "Traceback" not in rest


def test_run_with_another_size_of_camera_is_one_line(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((480, 640, 3), np.uint8))
    config = tmp_path / "config.toml"
    config.write_text(f'[camera.source]\nkind = "folder"\npath = "{tmp_path}"\n{QUIET}')
    command = [sys.executable, "-m", "service", "run", "--config", str(config)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 78
    lines = [line for line in done.stderr.splitlines() if not line.startswith("INFO")]
    assert lines == [
        "distloc: camera.width, camera.height are 1920 x 1080: the source gives 640 x 480, which must be that size "
        "or a whole fraction of it"
    ]
