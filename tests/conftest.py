"""How the tests are spread over the processes that run them side by side, and how properties are tried."""

import os

# As the service has it: before NumPy is loaded, in this process and those of xdist.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import HealthCheck, settings

# The same examples each time, and no limit that a slow machine meets.
settings.register_profile("project", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("project")

# What flies in real time: begun first, so that no process ends with it alone.
_LONG = ("tests/faults", "tests/service/flight", "tests/service/commands", "tests/service/publish")


def pytest_xdist_auto_num_workers() -> int:
    """Two a core, 16 at most: most tests wait for a socket, a subprocess or a frame."""
    return min(2 * len(os.sched_getaffinity(0)), 16)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The long ones first; a file's tests stay together, as they share their flights."""
    items.sort(key=lambda item: not item.nodeid.startswith(_LONG))
