"""`distloc ground` as a process, with drones of a test's own, for the tests of the crew's page."""

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

from service.config.sections import ZenohConfig
from service.publish.zenoh import ZenohPublisher
from tests.support.places import HANG_S, ROOT
from tests.support.ports import free_port


@dataclass
class Ground:
    """Where its page is, and its process."""

    address: str
    process: subprocess.Popen[str]


@contextlib.contextmanager
def ground(*arguments: str) -> Iterator[Ground]:
    """Serves on a port that is free; its first line says where."""
    command = [sys.executable, "-m", "service", "ground", "--port", "0", *arguments]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if "http" not in line:
            process.wait(HANG_S)
            assert process.stderr is not None
            raise AssertionError(f"no page: {line} {process.stderr.read()}")
        yield Ground("http" + line.strip().partition("http")[2], process)
    finally:
        process.terminate()
        process.communicate(timeout=HANG_S)


@contextlib.contextmanager
def drone(name: str = "drone1") -> Iterator[tuple[ZenohPublisher, str]]:
    """A publisher as the service has it, and the endpoint that a ground connects to."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ZenohPublisher(ZenohConfig(listen=(endpoint,)), name) as publisher:
        yield publisher, endpoint
