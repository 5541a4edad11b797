"""How the tests are spread over the processes that run them side by side."""

import os

import pytest

# What flies in real time: begun first, so that no process ends with it alone.
_LONG = ("tests/faults", "tests/service/flight", "tests/service/commands", "tests/service/publish")


def pytest_xdist_auto_num_workers() -> int:
    """Two a core: most tests wait for a socket, a subprocess or a frame."""
    return 2 * len(os.sched_getaffinity(0))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The long ones first; a file's tests stay together, as they share their flights."""
    items.sort(key=lambda item: not item.nodeid.startswith(_LONG))
