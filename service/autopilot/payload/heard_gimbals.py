"""Which gimbals are heard and which of them is the camera's; for `gimbal`."""

from typing import Any

AUTOPILOT_COMPONENT = 1
LAST_DEVICE = 6  # ids of gimbals that have no component of their own, GIMBAL_DEVICE_ATTITUDE_STATUS
MOST = 8
CONFIRMING = 3  # messages after which a gimbal is there: one odd message makes no second gimbal
# The better one counts where a sender sends several: of the older two only the angles are known, not their frames.
_RANKS = {"MOUNT_STATUS": 0, "MOUNT_ORIENTATION": 1, "GIMBAL_DEVICE_ATTITUDE_STATUS": 2}


class HeardGimbals:
    """Ids of the gimbals that were heard, for the whole flight: one that falls silent is not replaced by another.

    An id is 1 to 6 of a gimbal that the autopilot reports (1 where it gives none), else its component's.
    """

    def __init__(self, device: int) -> None:
        self.device = device
        self._kinds: dict[int, str] = {}  # of each component, the best that it sends
        self._counts: dict[int, int] = {}

    def take(self, message: Any) -> bool:
        """Note a gimbal's message; whether it is the followed one's, in the best kind of message that it sends."""
        kind, component = message.get_type(), message.get_srcComponent()
        best = self._kinds.get(component)
        if best is None and len(self._kinds) >= MOST and component not in (self.device, AUTOPILOT_COMPONENT):
            return False
        if best is not None and _RANKS[kind] < _RANKS[best]:
            return False
        if best is not None and kind != best:
            for one in self._of(component):
                del self._counts[one]
        self._kinds[component] = kind
        device = _id_of(message, component)
        if device not in self._counts and len(self._counts) >= MOST and device != self.device:
            return False
        self._counts[device] = min(self._counts.get(device, 0) + 1, CONFIRMING)
        return device == self.followed

    @property
    def ids(self) -> tuple[int, ...]:
        """Of all that are there, rising."""
        return tuple(sorted(device for device, count in self._counts.items() if count >= CONFIRMING))

    @property
    def followed(self) -> int | None:
        """The configured one, else the only one; None if there are several, or none yet."""
        if self.device:
            return self.device if self.device in self._counts else None
        there = self.ids or tuple(self._counts)
        return there[0] if len(there) == 1 else None

    @property
    def is_ambiguous(self) -> bool:
        """Whether several are there and none is configured."""
        return not self.device and len(self.ids) > 1

    @property
    def kind(self) -> str:
        """The message that tells the followed one's attitude."""
        component = self.followed if (self.followed or 0) > LAST_DEVICE else AUTOPILOT_COMPONENT
        return self._kinds.get(component or 0, "unheard")

    def _of(self, component: int) -> list[int]:
        is_autopilot = component == AUTOPILOT_COMPONENT
        return [one for one in self._counts if (one <= LAST_DEVICE if is_autopilot else one == component)]


def _id_of(message: Any, component: int) -> int:
    if component != AUTOPILOT_COMPONENT:
        return component
    device = int(getattr(message, "gimbal_device_id", 0))
    return device if 1 <= device <= LAST_DEVICE else AUTOPILOT_COMPONENT
