"""Cursor on Target to all links of [tak]: the drone's service and the ground both publish by this."""

import functools
import ssl
from collections.abc import Callable

from distloc.backports import Self
from service.config.tak_section import TakConfig, TakUrl, check_tak, tak_url
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import SharedFire
from service.publish.exchange.tak.board import Board
from service.publish.exchange.tak.channel import Channel, Datagrams, Stream
from service.publish.exchange.tak.credentials import tls_context
from service.publish.exchange.tak.link import Connect, TakLink


class TakPublisher:
    """Returns from all at once. ConfigError on construction, where a URL or a certificate cannot be used."""

    def __init__(self, config: TakConfig, clock: Callable[[], float], most_fires: int, most_drones: int) -> None:
        self._with_drones = config.drone
        self._links = [
            TakLink(name, connect, Board(most_fires, most_drones, config.tentative), clock)
            for name, connect in channels(config)
        ]

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    @property
    def is_lost(self) -> bool:
        """Whether a link was tried in vain."""
        return any(link.is_lost for link in self._links)

    @property
    def counters(self) -> dict[str, dict[str, object]]:
        """For the status, by URL."""
        return {link.name: link.counters for link in self._links}

    @property
    def linked(self) -> dict[str, bool]:
        """Whether each is connected."""
        return {link.name: link.is_connected for link in self._links}

    def open(self) -> None:
        for link in self._links:
            link.open()

    def close(self) -> None:
        for link in self._links:
            link.close()

    def tell_fire(self, fire: SharedFire) -> None:
        """The last word on a fire."""
        for link in self._links:
            link.tell_fire(fire)

    def withdraw(self, uid: str) -> None:
        """A fire that is told under another uid now, or no more."""
        for link in self._links:
            link.withdraw(uid)

    def tell_drone(self, drone: SharedDrone) -> None:
        """Where a drone is now."""
        if self._with_drones:
            for link in self._links:
                link.tell_drone(drone)


def channels(config: TakConfig) -> list[tuple[str, Connect]]:
    """Each URL and what opens it. ConfigError where a URL or a certificate cannot be used."""
    check_tak(config)
    urls = [tak_url(f"tak.urls[{number}]", one) for number, one in enumerate(config.urls)]
    context = tls_context(config) if any(one.scheme == "tls" for one in urls) else None
    return [(url.text, functools.partial(_connected, url, config, context)) for url in urls]


def _connected(url: TakUrl, config: TakConfig, context: ssl.SSLContext | None) -> Channel:
    if url.scheme == "udp":
        return Datagrams(url, config.interface)
    return Stream(url, context if url.scheme == "tls" else None, config.server_name)
