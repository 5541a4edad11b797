"""One browser for the tests of a file, and a drone whose page they share."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from service.publish.zenoh import ZenohPublisher
from tests.support.browser import chromium
from tests.support.crew_ground import drone, ground


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as one:
        yield one


@pytest.fixture(scope="module")
def crew() -> Iterator[tuple[ZenohPublisher, str]]:
    """A drone's publisher, and the address of the page that shows it."""
    with drone() as (publisher, endpoint), ground("--connect", endpoint) as served:
        yield publisher, served.address
