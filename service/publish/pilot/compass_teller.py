"""What the pilot is told of the compass as text, and when; the MAVLink publisher asks. Free of I/O."""

import math

from service.localise.scenery import SceneryState

APART_NS = 120_000_000_000
CHANGED_DEG = 2.0


class CompassTeller:
    """Tells how far the heading is off once that has stood, again where it changed by over 2 degrees."""

    def __init__(self) -> None:
        self._told_deg: float | None = None
        self._told_ns = 0

    def due(self, scenery: SceneryState, now_ns: int) -> bytes | None:
        """The text to send now, if any: at most 50 bytes of ASCII."""
        error_rad = scenery.heading_error_rad
        if not scenery.is_off or error_rad is None:
            return None
        error_deg = math.degrees(error_rad)
        if self._told_deg is not None:
            changed_deg = math.remainder(error_deg - self._told_deg, 360.0)
            if abs(changed_deg) <= CHANGED_DEG or now_ns - self._told_ns < APART_NS:
                return None
        self._told_deg, self._told_ns = error_deg, now_ns
        return f"Compass off by {error_deg:+.1f} deg".encode("ascii")
