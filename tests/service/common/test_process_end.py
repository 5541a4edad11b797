"""A process of ours ends with its status, all output written, and no interpreter taking itself down under threads."""

import subprocess
import sys

import pytest

from tests.support.places import HANG_S

PROGRAM = """
import atexit, sys, threading
from service.common.process_end import run_process

class Last:
    def __del__(self):
        print("the interpreter was taken down")

kept = Last()

def main():
    atexit.register(print, "what was registered later")
    threading.Timer(0.2, print, ["a thread that is waited for"]).start()
    {ending}

run_process(main)
"""


@pytest.mark.parametrize(
    ("ending", "status"),
    [
        ("print('returned')", 0),
        ("sys.exit(78)", 78),
        ("sys.exit()", 0),
        ("sys.exit('why')", 1),
        ("raise ValueError('wrong')", 1),
    ],
)
def test_the_status_is_main_s_and_the_interpreter_is_not_taken_down(ending: str, status: int) -> None:
    command = [sys.executable, "-c", PROGRAM.format(ending=ending)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == status
    lines = done.stdout.splitlines()
    assert lines[-2:] == ["a thread that is waited for", "what was registered later"]
    assert ("wrong" in done.stderr, "why" in done.stderr) == ("wrong" in ending, "why" in ending)


def test_a_closed_pipe_does_not_change_the_status() -> None:
    command = f"{sys.executable} -m service --help | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode in (0, 1)
    assert "Exception ignored" not in done.stderr


def test_output_that_cannot_be_written_is_a_failure() -> None:
    command = f"env -u PYTHONUNBUFFERED {sys.executable} -m service --help > /dev/full"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 1
