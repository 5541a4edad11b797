"""What the picture takes from zenoh's keys, and what it gives to other programs."""

from collections.abc import Mapping, Set
from typing import NamedTuple

from service.common.shown import shown
from service.ground.picture.drone import NAME_CHARACTERS
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import SharedFire


class Shared(NamedTuple):
    """As other programs are told."""

    fires: list[SharedFire]
    drones: list[SharedDrone]
    gone: tuple[str, ...] = ()  # uids: part of a fused fire now, or no more


class ToldUids:
    """What other programs were told last, by the picture's ids: as many as it has fires."""

    def __init__(self) -> None:
        self._uids: dict[str, str] = {}

    def gone(self, changed: Set[str], now: Mapping[str, str]) -> tuple[str, ...]:
        """The uids of what changed that are told no more; `now` has the uids by id of what is told now."""
        before = [self._uids.pop(one) for one in sorted(changed & self._uids.keys())]
        self._uids.update(now)
        still = set(self._uids.values()) if before else set()
        return tuple(uid for uid in before if uid not in still)


def key_parts(key: str) -> tuple[str, str, str]:
    """Vehicle, kind and number of `distloc/VEHICLE/KIND[/NUMBER]`, printable."""
    vehicle, _, rest = key.removeprefix("distloc/").partition("/")
    kind, _, number = rest.partition("/")
    return shown(vehicle, most=NAME_CHARACTERS), kind, number[:20]
