"""distloc runs on Python 3.10, JetPack 6's: what is newer is chosen in two modules, and missed nowhere else."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.project.test_layers import MODULES
from tests.support.as_python_3_10 import NEWER
from tests.support.places import CUT, HANG_S, ROOT

CHOOSERS = ("distloc.backports", "service.common.aio")
EXTRAS = (  # need packages of extras or of the system, which bring what they like
    "service.commands.bench.published",
    "service.camera.command.gst_frames",
)
HIDE = "from tests.support.as_python_3_10 import hide_newer\nhide_newer()"
SERVE = """
import asyncio, socket
from service.common import aio
from service.config.sections import Config, LinkConfig, MavlinkConfig, ZenohConfig
from service.flight.app import App

async def fly():
    with socket.create_server(("127.0.0.1", 0)) as server:  # a TCP client connects under a time limit
        urls = ("udpin:127.0.0.1:0", f"tcp:127.0.0.1:{server.getsockname()[1]}")
        links = tuple(LinkConfig(url=url) for url in urls)
        app, stop = App(Config(mavlink=MavlinkConfig(links=links), zenoh=ZenohConfig(enabled=False))), asyncio.Event()
        serving = asyncio.create_task(app.run(stop))
        while not all(link.state == "open" for link in app.links) and not serving.done():
            await asyncio.sleep(0.01)
        stop.set()
        await serving
        return "served"

print(aio.run(fly()), aio.run.__module__, aio.TaskGroup.__module__)
"""


def as_3_10(script: str, *arguments: str) -> str:
    """What a script prints in a process where distloc sees Python 3.10's library."""
    command = [sys.executable, "-c", f"{HIDE}\n{script}", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_can_be_imported() -> None:
    modules = [module for module in MODULES if not module.startswith((*EXTRAS, "service.__main__"))]
    script = "import importlib, json, sys\nfor name in json.loads(sys.argv[1]): importlib.import_module(name)"
    as_3_10(script, json.dumps(modules))


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="taskgroup, 3.10's, runs on Python 3.12 at the latest")
def test_the_service_flies_with_the_backports() -> None:
    assert as_3_10(SERVE) == "served service.common.aio taskgroup.taskgroups\n"


def test_a_recording_is_replayed(tmp_path: Path) -> None:
    shutil.copytree(CUT, tmp_path / "flight")
    frames = (CUT / "frames.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "flight/frames.csv").write_text("".join(frames[:40]), encoding="utf-8")
    script = "from service.commands.cli import main\nmain()"
    said = as_3_10(script, "replay", str(tmp_path / "flight"), "--out", str(tmp_path / "out"))
    assert "frames used" in said and (tmp_path / "out/status.json").exists()


@pytest.mark.parametrize("newer", ["from enum import StrEnum", "import asyncio; asyncio.timeout", "import tomllib"])
def test_what_is_newer_would_be_found(newer: str) -> None:
    script = f"exec({newer!r}, {{'__name__': 'service.made_up'}})"
    with pytest.raises(AssertionError, match=r"StrEnum|timeout|tomllib"):
        as_3_10(script)


def test_two_modules_choose() -> None:
    choosing = [module for module, path in MODULES.items() if "version_info" in path.read_text(encoding="utf-8")]
    assert sorted(choosing) == sorted(CHOOSERS)


@pytest.mark.skipif(sys.version_info >= (3, 11), reason="compares with Python 3.10's own library")
def test_what_is_called_newer_is_newer() -> None:
    for module, names in NEWER.items():
        __import__(module)
        assert not [name for name in names.split() if hasattr(sys.modules[module], name)], module
