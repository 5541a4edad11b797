"""A real Chromium without a window, if one is installed; what it complains of, and what it asks whom for, is kept."""

import contextlib
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

from tests.support.places import HANG_S

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed: apt-get install chromium")
expect.set_options(timeout=HANG_S * 1000.0)  # a condition is waited for however slow the machine is
SIZES = {"desk": (1280, 800), "phone": (390, 844)}


@dataclass
class Watched:
    """A page, what its console said, and whom else than its server it asked."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)


@contextlib.contextmanager
def chromium() -> Iterator[Browser]:
    """Started and ended; as root, as in CI, it runs without its own sandbox."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def watched(browser: Browser, address: str, size: str = "desk", theme: str = "light", **more: Any) -> Iterator[Watched]:
    """The page at an address; ends with the test."""
    width, height = SIZES[size]
    context = browser.new_context(
        viewport={"width": width, "height": height},
        color_scheme="dark" if theme == "dark" else "light",
        permissions=["clipboard-read", "clipboard-write"],
        **more,
    )
    context.set_default_timeout(HANG_S * 1000.0)
    one = Watched(context.new_page())
    server = address.partition("?")[0].split("/")[2]
    one.page.on("console", lambda said: one.complaints.append(said.text) if said.type in ("error", "warning") else None)
    one.page.on("pageerror", lambda error: one.complaints.append(str(error)))
    one.page.on("request", lambda asked: None if server in asked.url[:40] else one.strangers.append(asked.url))
    try:
        one.page.goto(address)
        yield one
    finally:
        context.close()


def row(page: Page, target: int, vehicle: str = "drone1") -> Locator:
    """A fire's row in the table."""
    return page.locator(f'tr[data-fire="{vehicle}/{target}"]')
