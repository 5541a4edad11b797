import shutil
import subprocess
import sys
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[1] / "systemd" / "distloc.service"
pytestmark = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def checked(folder: Path, *more: str) -> str:
    """The unit's copy with an executable that exists here, and what systemd-analyze says of it."""
    text = UNIT.read_text(encoding="utf-8")
    assert "ExecStart=/opt/distloc/bin/distloc run --config /etc/distloc/config.toml\n" in text
    unit = folder / "distloc.service"
    unit.write_text(
        text.replace("/opt/distloc/bin/distloc", sys.executable).replace("README.md", "x"), encoding="utf-8"
    )
    command = ["systemd-analyze", *more, str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return f"{done.stdout}{done.stderr}" + (f"exit {done.returncode}" if done.returncode else "")


def test_verify_says_nothing(tmp_path: Path) -> None:
    assert checked(tmp_path, "verify") == ""


def test_it_is_hardened(tmp_path: Path) -> None:
    assert (
        "exit" not in checked(tmp_path, "security", "--offline=true", "--threshold=25", "--no-pager").splitlines()[-1]
    )


@pytest.mark.parametrize("line", ["Type=notify", "Restart=always", "RestartPreventExitStatus=78", "User=distloc"])
def test_what_the_service_counts_on(line: str) -> None:
    assert line in UNIT.read_text(encoding="utf-8").splitlines()
