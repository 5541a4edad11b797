"""What the ground station says of its links and of who is there, line by line and once a change. Free of I/O."""

from collections import OrderedDict

import msgspec

from service.common.degraded import Degraded
from service.common.shown import shown
from service.publish.wire import StatusReport

MAX_VEHICLES = 64
_MOST_NAMES = 32
_MEANINGS = {str(one): one.meaning for one in Degraded}


class VehicleWatch:
    """Takes what zenoh tells and gives the lines that are news; the last word on each of the newest 64 is kept."""

    def __init__(self) -> None:
        self._links: dict[str, bool] = {}
        self._last: OrderedDict[str, str] = OrderedDict()

    def link(self, endpoint: str, is_connected: bool) -> list[str]:
        """Whether there is a link to an endpoint of the command line, now."""
        if self._links.get(endpoint) is is_connected:
            return []
        self._links[endpoint] = is_connected
        if is_connected:
            return [f"connected to {shown(endpoint)}"]
        return [f"not connected to {shown(endpoint)}: trying again; is distloc running there, with zenoh.listen?"]

    def alive(self, key: str, is_there: bool) -> list[str]:
        """A liveliness token came or went: `distloc/VEHICLE/alive`."""
        vehicle = _vehicle(key)
        if not is_there:
            self._last.pop(vehicle, None)
            return [f"{vehicle} is gone: no word of it any more, and nothing new of its targets"]
        return [f"{vehicle} is there"] if vehicle not in self._last and self._news(vehicle, "") else []

    def status(self, key: str, payload: bytes) -> list[str]:
        """A status message: `distloc/VEHICLE/status`."""
        vehicle = _vehicle(key)
        try:
            text = status_text(msgspec.json.decode(payload, type=StatusReport))
        except (msgspec.MsgspecError, RecursionError) as error:
            text = f"status cannot be read: {shown(error)}"
        return [f"{vehicle} {text}"] if self._news(vehicle, text) else []

    def _news(self, vehicle: str, text: str) -> bool:
        is_news = self._last.get(vehicle) != text
        self._last[vehicle] = text
        self._last.move_to_end(vehicle)
        if len(self._last) > MAX_VEHICLES:
            self._last.popitem(last=False)
        return is_news


def status_text(status: StatusReport) -> str:
    """`ok`, or what is degraded and what that means."""
    if not status.degraded:
        return shown(status.state)
    names = [f"{shown(name)} ({_MEANINGS[name]})" if name in _MEANINGS else shown(name) for name in status.degraded]
    more = f", and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"{shown(status.state)}: {', '.join(names[:_MOST_NAMES])}{more}"


def _vehicle(key: str) -> str:
    return shown(key.removeprefix("distloc/").rpartition("/")[0], most=64)
