"""What the picture takes from zenoh's keys, and what it gives to other programs."""

from typing import NamedTuple

from service.common.shown import shown
from service.ground.picture.drone import NAME_CHARACTERS
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import SharedFire


class Shared(NamedTuple):
    """As other programs are told."""

    fires: list[SharedFire]
    drones: list[SharedDrone]


def key_parts(key: str) -> tuple[str, str, str]:
    """Vehicle, kind and number of `distloc/VEHICLE/KIND[/NUMBER]`, printable."""
    vehicle, _, rest = key.removeprefix("distloc/").partition("/")
    kind, _, number = rest.partition("/")
    return shown(vehicle, most=NAME_CHARACTERS), kind, number[:20]
