"""The browsers that watch: each gets all at first, then what is new; a slow one gets all again when it is ready."""

import asyncio
from collections.abc import Callable

from aiohttp import WSMsgType, web

MOST_WATCHERS = 32
MOST_WORD_BYTES = 4_096  # what a page may say at once
_BEAT_S = 20.0


class Hub:
    """Sends to all, waits for none. `whole` gives the whole picture as JSON, `on_word` takes what a page says."""

    def __init__(self, whole: Callable[[], str], on_word: Callable[[str], None]) -> None:
        self._whole, self._on_word = whole, on_word
        self._watchers: set[_Watcher] = set()

    def __len__(self) -> int:
        return len(self._watchers)

    def send(self, news: str) -> None:
        """To every watcher that has read what came before."""
        for one in self._watchers:
            one.offer(news)

    async def handle(self, request: web.Request) -> web.StreamResponse:
        """The live channel of one page, until it goes."""
        if len(self._watchers) >= MOST_WATCHERS:
            return web.Response(status=503, text=f"{MOST_WATCHERS} pages watch already: close one\n")
        socket = web.WebSocketResponse(heartbeat=_BEAT_S, max_msg_size=MOST_WORD_BYTES, compress=False)
        await socket.prepare(request)
        watcher = _Watcher(socket, self._whole)
        self._watchers.add(watcher)
        writing = asyncio.create_task(watcher.write(), name="watcher")
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
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
    """One page: what is to be sent next, one message at most."""

    def __init__(self, socket: web.WebSocketResponse, whole: Callable[[], str]) -> None:
        self.socket, self._whole = socket, whole
        self._next: str | None = None
        self._wants_whole = True
        self._is_due = asyncio.Event()
        self._is_due.set()

    def offer(self, news: str) -> None:
        self._wants_whole = self._wants_whole or self._next is not None
        self._next = news
        self._is_due.set()

    async def write(self) -> None:
        """Until cancelled, or the page is gone."""
        while not self.socket.closed:
            await self._is_due.wait()
            self._is_due.clear()
            text, self._next = self._whole() if self._wants_whole else self._next, None
            self._wants_whole = False
            if text is not None:
                try:
                    await self.socket.send_str(text)
                except (ConnectionError, RuntimeError):  # it goes; RuntimeError: it is closing
                    return
