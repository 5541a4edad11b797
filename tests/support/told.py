"""What a ground tells a page over its WebSocket, for the tests that need no browser."""

import contextlib
from collections.abc import AsyncIterator, Callable

import aiohttp
import msgspec

from service.common import aio
from service.ground.picture.views import News
from service.ground.web.hub import READY
from tests.support.places import HANG_S


@contextlib.asynccontextmanager
async def live(address: str) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
    """The live channel of a page."""
    async with aiohttp.ClientSession() as session, session.ws_connect(f"{address}live", max_msg_size=0) as socket:
        yield socket


async def until(socket: aiohttp.ClientWebSocketResponse, is_so: Callable[[News], bool]) -> News:
    """The first news that is so."""
    async with aio.timeout(HANG_S):
        while True:
            news = msgspec.json.decode((await socket.receive()).data, type=News)
            await socket.send_str(READY)
            if is_so(news):
                return news
