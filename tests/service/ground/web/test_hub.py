"""What pages are told: all at first, then news at the speed of each, with nothing old and nothing left out."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import aiohttp
from aiohttp import web

from service.ground.picture.views import Changed
from service.ground.web.hub import READY, Hub


@asynccontextmanager
async def served(hub: Hub) -> AsyncIterator[str]:
    application = web.Application()
    application.router.add_get("/live", hub.handle)
    runner = web.AppRunner(application)
    await runner.setup()
    try:
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        yield f"http://127.0.0.1:{runner.addresses[0][1]}/live"
    finally:
        await hub.close()
        await runner.cleanup()


def test_a_slow_page_is_told_at_once_of_all_that_changed_and_never_of_what_was() -> None:
    version = [0]

    def news(changed: Changed | None) -> str:
        return f"{version[0]} {'all' if changed is None else ' '.join(sorted(changed.fires))}"

    async def run() -> None:
        hub = Hub(news, lambda _: None)
        async with served(hub) as address, aiohttp.ClientSession() as session, session.ws_connect(address) as page:
            assert (await page.receive()).data == "0 all"
            for number in range(1, 1000):
                version[0] = number
                hub.send(Changed(frozenset({f"fire{number % 3}"})))
            await page.send_str(READY)
            assert (await page.receive()).data == "999 fire0 fire1 fire2"
            await page.send_str(READY)
            version[0] = 1000
            hub.send(Changed())  # a beat: nothing changed, and the page knows that it is told
            assert (await page.receive()).data == "1000 "

    asyncio.run(run())
