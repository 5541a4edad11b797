"""Whether Cursor on Target goes out at all: what it needs is loaded only where [tak] has a URL."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Union

from distloc.backports import Self
from service.config.tak_section import TakConfig
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import SharedFire

if TYPE_CHECKING:
    from service.publish.exchange.tak.publisher import TakPublisher


class NullTak:
    """[tak] without a URL."""

    is_lost = False

    @property
    def counters(self) -> dict[str, dict[str, object]]:
        return {}

    @property
    def linked(self) -> dict[str, bool]:
        return {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        """Does nothing."""

    def open(self) -> None:
        """Does nothing."""

    def close(self) -> None:
        """Does nothing."""

    def tell_fire(self, fire: SharedFire) -> None:
        """Does nothing."""

    def withdraw(self, uid: str) -> None:
        """Does nothing."""

    def tell_drone(self, drone: SharedDrone) -> None:
        """Does nothing."""


def make_tak(
    config: TakConfig, clock: Callable[[], float], most_fires: int, most_drones: int = 1
) -> Union["TakPublisher", NullTak]:
    """A publisher where the section has URLs."""
    if not config.urls:
        return NullTak()
    from service.publish.exchange.tak.publisher import TakPublisher

    return TakPublisher(config, clock, most_fires, most_drones)
