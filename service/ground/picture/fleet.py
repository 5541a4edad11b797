"""The drones of the picture, bounded. Free of I/O."""

from collections import OrderedDict
from collections.abc import Callable

from service.ground.picture.drone import STAYS, Drone

MOST_DRONES = 128


class Fleet:
    """`changed` has the names of which there is news; a drone that had to go is counted in `left_out` and told to
    `forget`."""

    def __init__(self, forget: Callable[[str], None]) -> None:
        self.by_name: OrderedDict[str, Drone] = OrderedDict()  # the one heard last is last
        self.changed: set[str] = set()
        self.left_out = 0
        self._forget = forget

    def heard(self, vehicle: str, now_s: float) -> Drone | None:
        """Made where it is new; None where all places are taken by drones that go on telling."""
        drone = self.by_name.get(vehicle)
        if drone is None:
            if len(self.by_name) >= MOST_DRONES and not self._make_place(now_s):
                self.left_out += 1
                return None
            drone = self.by_name[vehicle] = Drone(vehicle, now_s)
        self.by_name.move_to_end(vehicle)
        drone.heard_s = now_s
        self.changed.add(vehicle)
        return drone

    def places(self) -> list[tuple[float, float]]:
        """Where drones are, in degrees."""
        return [drone.place for drone in self.by_name.values() if drone.place is not None]

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much."""
        for drone in self.by_name.values():
            drone.set_clock_on(step_s)
        self.changed |= self.by_name.keys()

    def _make_place(self, now_s: float) -> bool:
        """Forget the drone that is missed least, of several the one heard longest ago."""
        least = min(self.by_name.values(), key=lambda one: one.is_missed(now_s))
        if least.is_missed(now_s) == STAYS:
            return False
        del self.by_name[least.name]
        self.changed.add(least.name)
        self.left_out += 1
        self._forget(least.name)
        return True
