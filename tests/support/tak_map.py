"""What an ATAK would show of the events that it hears, by its own rules."""

from tests.support.shared_fires import Drawn, drawn


class Client:
    """An ATAK: markers until they faded, drawings until they are taken off."""

    def __init__(self) -> None:
        self.markers: dict[str, tuple[Drawn, float]] = {}
        self.drawings: dict[str, Drawn] = {}

    def hear(self, events: list[bytes], now_s: float) -> None:
        self.take([drawn(one) for one in events], now_s)

    def take(self, events: list[Drawn], now_s: float) -> None:
        for one in events:
            if one.removes is not None:
                self.markers.pop(one.removes, None)
                self.drawings.pop(one.removes, None)
            elif one.kind == "u-d-f":
                self.drawings[one.uid] = one
            else:
                assert one.fades_after_s is not None
                self.markers[one.uid] = (one, now_s + one.fades_after_s)

    def shows(self, now_s: float) -> set[str]:
        """What is not faded."""
        return {uid for uid, (_, until_s) in self.markers.items() if now_s < until_s} | set(self.drawings)
