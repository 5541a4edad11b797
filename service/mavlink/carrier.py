"""What carries a link's bytes, and what a link's opening raises; the link and every kind of carrier share it."""

from collections.abc import Callable
from typing import Protocol

from service.mavlink.framer import Framer

MOST_WAIT_S = 5.0  # for a connection, and between two tries
MOST_PEERS = 4
READ_BYTES = 4_096

Received = Callable[[bytes, Framer], bool]  # the framer of who sent the bytes; whether something valid was among them


class LinkError(Exception):
    """A link cannot be opened and waiting will not help; one line for the operator."""


class Carrier(Protocol):
    """One open connection of some kind."""

    port: int

    async def wait_closed(self) -> None:
        """Return or raise OSError once it is lost."""

    def write(self, data: bytes) -> bool:
        """Send without waiting; False if the bytes were dropped."""

    def is_moving(self) -> bool:
        """Whether what carries the bytes, a thread it may be, still runs; asked every second."""

    def close(self) -> None:
        """Give the device back."""
