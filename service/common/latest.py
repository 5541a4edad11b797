"""One slot between two stages: the newest wins, what it replaced is counted."""

import asyncio
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Put from the event loop's thread, awaited by one consumer."""

    def __init__(self) -> None:
        self.dropped = 0
        self._item: T | None = None
        self._filled = asyncio.Event()

    def put(self, item: T) -> None:
        """Fill the slot; an item that nobody took is lost and counted."""
        if self._item is not None:
            self.dropped += 1
        self._item = item
        self._filled.set()

    async def get(self) -> T:
        """Wait for an item and empty the slot."""
        await self._filled.wait()
        self._filled.clear()
        item, self._item = self._item, None
        assert item is not None
        return item
