"""`distloc ground` and what it is told wrongly: one line that says what would be right, and the right exit code."""

import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from service.commands.cli import main
from tests.support.ports import free_port


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder of files that are none of what is asked for."""
    (tmp_path / "empty").write_text("")
    for name, text, mode in (("open", "a-token-of-ours-1234\n", 0o644), ("short", "abc", 0o600)):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(mode)
    return tmp_path


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """Those of the signals are the test's again afterwards."""
    kept = {one: signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


AT = ("--connect", "AT")


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ((), 2, "where are the drones?"),
        ((*AT, "--out", "x"), 2, "goes with --print"),
        (("--replay", "empty"), 1, "holds no message of a drone"),
        (("--replay", "none"), 1, "none: No such file"),
        ((*AT, "--token-file", "open"), 78, "must be 0600"),
        ((*AT, "--token-file", "short"), 2, "has 3 characters"),
        ((*AT, "--record", "empty"), 1, "empty: File exists"),
        (("--connect", "nonsense"), 78, "zenoh: connect/endpoints"),
        (("--print", "--connect", "nonsense"), 78, "zenoh: connect/endpoints"),
        ((*AT, "--export", "x.html"), 2, "needs --replay"),
        (("--replay", "none", "--export", "x.html"), 1, "none: No such file"),
        ((*AT, "--tiles", "empty"), 1, "--tiles empty: is neither an MBTiles nor a PMTiles file"),
        ((*AT, "--tiles", "ftp://a/{z}/{x}/{y}"), 1, "no http or https address"),
        ((*AT, "--tiles", "none\x1b[2J"), 1, r"--tiles none\x1b[2J: No such file"),
        ((*AT, "--dem", "none"), 1, "--dem: none: no such file"),
        ((*AT, "--dem", "."), 1, "holds no DEM"),
        ((*AT, "--places", "empty"), 1, "no GeoJSON FeatureCollection"),
        ((*AT, "--host", "192.0.2.1"), 1, "192.0.2.1:8080"),
    ],
)
def test_it_is_one_line_and_the_right_exit_code(
    files: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    code: int,
    words: str,
) -> None:
    monkeypatch.chdir(files)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    monkeypatch.setattr(sys, "argv", ["distloc", "ground", *(endpoint if one == "AT" else one for one in arguments)])
    with pytest.raises(SystemExit) as exit_:
        main()
    said = capfd.readouterr().err
    assert (exit_.value.code, words in said.splitlines()[-1]) == (code, True), said
    assert "Traceback" not in said and "\x1b" not in said
