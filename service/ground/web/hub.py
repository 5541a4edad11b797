"""The browsers that watch: each gets all at first, then what is new, as fast as it can take it."""

import asyncio
from collections.abc import Callable

from aiohttp import WSMsgType, web

from service.ground.picture.views import Changed

MOST_WATCHERS = 32
MOST_WORD_BYTES = 4_096  # what a page may say at once
READY = ""  # what a page says when it has shown what it was told
_BEAT_S = 20.0

News = Callable[[Changed | None], str]


class Hub:
    """Sends to all, waits for none. `news` makes the JSON of what changed, of all for None; `on_word` takes marks."""

    def __init__(self, news: News, on_word: Callable[[str], None]) -> None:
        self._news, self._on_word = news, on_word
        self._watchers: set[_Watcher] = set()

    def send(self, changed: Changed) -> None:
        """To every watcher, once it has shown what came before."""
        for one in self._watchers:
            one.offer(changed)

    async def handle(self, request: web.Request) -> web.StreamResponse:
        """The live channel of one page, until it goes."""
        if len(self._watchers) >= MOST_WATCHERS:
            return web.Response(status=503, text=f"{MOST_WATCHERS} pages watch already: close one\n")
        socket = web.WebSocketResponse(heartbeat=_BEAT_S, max_msg_size=MOST_WORD_BYTES, compress=False)
        if "Sec-WebSocket-Protocol" in request.headers:
            raise web.HTTPBadRequest  # no page of ours; aiohttp would log it
        try:
            await socket.prepare(request)
        except ValueError as error:  # a key of no ASCII
            raise web.HTTPBadRequest from error
        watcher = _Watcher(socket, self._news)
        self._watchers.add(watcher)
        writing = asyncio.create_task(watcher.write(), name="watcher")
        try:
            async for message in socket:
                if message.type is not WSMsgType.TEXT:
                    continue
                if message.data == READY:
                    watcher.is_ready.set()
                else:
                    self._on_word(message.data)
        finally:
            self._watchers.discard(watcher)
            writing.cancel()
        return socket

    async def close(self) -> None:
        """Tell them that it ends."""
        for one in list(self._watchers):
            await one.socket.close(code=1001)


class _Watcher:
    """One page. What it was not told yet is only names, so a slow page costs no memory and gets no old news."""

    def __init__(self, socket: web.WebSocketResponse, news: News) -> None:
        self.socket, self._news = socket, news
        self.is_ready, self._is_due = asyncio.Event(), asyncio.Event()
        self._changed = Changed()

    def offer(self, changed: Changed) -> None:
        self._changed = self._changed.also(changed)
        self._is_due.set()

    async def write(self) -> None:
        """Until cancelled, or the page is gone."""
        text = self._news(None)
        while True:
            try:
                await self.socket.send_str(text)
            except (ConnectionError, RuntimeError):  # it goes; RuntimeError: it is closing
                return
            await self.is_ready.wait()
            await self._is_due.wait()
            self.is_ready.clear()
            self._is_due.clear()
            changed, self._changed = self._changed, Changed()
            text = self._news(changed)
