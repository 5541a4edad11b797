"""What a watcher of the ground has and when: the page in a Chromium without a window, or what a page would be told."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

import msgspec

from service.common import aio
from service.ground.picture.views import FireView, News

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_ALL = """most => document.querySelectorAll("tr[data-fire]").length
    + (Number.parseInt(document.getElementById("more").textContent) || 0) >= most"""
# Moves the map in each picture of the screen, with everything on it, for so long.
_FRAMES = """([lat, lon, ms]) => new Promise((done) => {
  let frames = 0;
  const begun = performance.now();
  const step = () => {
    const taken = performance.now() - begun;
    if (taken > ms) return done((frames * 1000) / taken);
    distloc.look(lat + 0.01 * Math.sin(frames++ / 20), lon, 6);
    requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
})"""
_WATCH = """([fire, size]) => {
  window.seen = new Promise((done) => {
    const watcher = new MutationObserver(() => {
      const cell = document.querySelector(`tr[data-fire="${fire}"] .size`);
      if (cell?.textContent.match(/^±\\s*(\\d+)\\s*m/)?.[1] !== String(size)) return;
      watcher.disconnect();
      requestAnimationFrame(() => done(Date.now() / 1000));
    });
    watcher.observe(document.getElementById("fires"), { subtree: true, childList: true, characterData: true });
  });
}"""


class Screen(Protocol):
    """One who watches."""

    kind: str

    def late_s(self, fires: int) -> float:
        """Seconds from coming to having that many fires."""

    def frames_hz(self, lat_deg: float, lon_deg: float, seconds: float) -> float | None:
        """Pictures a second while the map moves; None where there is none to see."""

    def seen_after_s(self, fire_id: str, size_m: int, tell: Callable[[], None]) -> float | None:
        """Seconds from `tell` to that fire's ellipse shown so long; None where it is not in time."""


@contextlib.contextmanager
def screen(address: str, names: Sequence[str] = BROWSERS, limit_s: float = 30.0) -> Iterator[Screen]:
    """A Chromium that is installed under one of these names, and Playwright to drive it; else a WebSocket.

    Nothing is waited for longer than `limit_s`.
    """
    path = next(filter(None, map(shutil.which, names)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        path = None
    if path is None:
        yield Told(address, limit_s)
        return
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield Shown(address, limit_s, browser.new_page(viewport={"width": 1280, "height": 800}))
        finally:
            browser.close()


class Shown:
    """A page as it is drawn."""

    kind = "chromium"

    def __init__(self, address: str, limit_s: float, page: Any) -> None:
        self._address, self._limit_s, self._page = address, limit_s, page
        page.set_default_timeout(limit_s * 1000.0)

    def late_s(self, fires: int) -> float:
        """See Screen."""
        begun_s = time.monotonic()
        self._page.goto(self._address)
        self._page.wait_for_function(_ALL, arg=fires, polling="raf")
        return time.monotonic() - begun_s

    def frames_hz(self, lat_deg: float, lon_deg: float, seconds: float) -> float | None:
        """See Screen."""
        return float(self._page.evaluate(_FRAMES, [lat_deg, lon_deg, seconds * 1000.0]))

    def seen_after_s(self, fire_id: str, size_m: int, tell: Callable[[], None]) -> float | None:
        """See Screen."""
        self._page.evaluate(_WATCH, [fire_id, size_m])
        begun_s = time.time()  # the page's clock
        tell()
        limit = f"new Promise((done) => setTimeout(() => done(null), {self._limit_s * 1000.0:.0f}))"
        seen_s = self._page.evaluate(f"Promise.race([window.seen, {limit}])")
        return None if seen_s is None else max(seen_s - begun_s, 0.0)


class Told:
    """What a page would be told, over its WebSocket."""

    kind = "websocket"

    def __init__(self, address: str, limit_s: float) -> None:
        self._address, self._limit_s = f"{address}live", limit_s

    def late_s(self, fires: int) -> float:
        """See Screen."""
        begun_s = time.monotonic()
        if not aio.run(self._until(lambda known: len(known) >= fires, lambda: None)):
            raise RuntimeError(f"the ground did not tell of {fires} fires within {self._limit_s:.0f} s")
        return time.monotonic() - begun_s

    def frames_hz(self, lat_deg: float, lon_deg: float, seconds: float) -> float | None:
        """See Screen."""
        return None

    def seen_after_s(self, fire_id: str, size_m: int, tell: Callable[[], None]) -> float | None:
        """See Screen."""
        begun_s = 0.0

        def begin() -> None:
            nonlocal begun_s
            begun_s = time.monotonic()
            tell()

        def is_seen(known: dict[str, FireView]) -> bool:
            return fire_id in known and known[fire_id].ellipse95.semi_major_m == size_m

        is_there = aio.run(self._until(is_seen, begin))
        return time.monotonic() - begun_s if is_there else None

    async def _until(self, is_so: Callable[[dict[str, FireView]], bool], begin: Callable[[], None]) -> bool:
        """Whether what is told comes to be so in time; `begin` is called once all is known that was before."""
        import aiohttp  # of the extra `ground`

        from service.ground.web.hub import READY

        known: dict[str, FireView] = {}
        with contextlib.suppress(TimeoutError):
            async with (
                aio.timeout(self._limit_s),
                aiohttp.ClientSession() as session,
                session.ws_connect(self._address, max_msg_size=0) as socket,
            ):
                while True:
                    is_first = not known
                    news = msgspec.json.decode((await socket.receive()).data, type=News)
                    await socket.send_str(READY)
                    known |= {one.id: one for one in news.fires}
                    if is_first:
                        begin()
                    if is_so(known):
                        return True
        return False
