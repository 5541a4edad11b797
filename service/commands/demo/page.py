"""The demo's fire on the crew's page: `distloc ground` beside it, its address said, opened where there is a display."""

import contextlib
import importlib.util
import os
import subprocess
import sys
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path

_END_S = 5.0


@contextlib.contextmanager
def crew_page(endpoint: str, log: Path, say: Callable[[str], None]) -> Iterator[None]:
    """While the demo flies; without the extra `ground` a line says what lacks, and the demo goes on."""
    if any(importlib.util.find_spec(name) is None for name in ("aiohttp", "mgrs")):
        say("to see the fire on a map in the browser: pip install '.[ground]'")
        yield
        return
    command = [sys.executable, "-m", "service", "ground", "--connect", endpoint, "--port", "0"]
    with log.open("wb") as errors:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        if line:
            say(line)
            if has_display():
                webbrowser.open(line[line.index("http") :])
        yield
    finally:
        process.terminate()
        try:
            process.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            process.kill()


def has_display() -> bool:
    """Whether a browser's window could be seen: always but on a Unix without X or Wayland."""
    is_bare_unix = sys.platform not in ("darwin", "win32")
    return not is_bare_unix or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
