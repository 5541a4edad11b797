"""What the operator is told of faults as text, and when; the MAVLink publisher asks. Free of I/O."""

SETTLED_NS = 2_000_000_000  # what comes and goes faster is left to the status message
_MOST_BYTES = 50  # of a STATUSTEXT


class FaultTeller:
    """Tells the names of what is degraded once they have stood for two seconds, and once all is well again."""

    def __init__(self) -> None:
        self._told: tuple[str, ...] = ()
        self._seen: tuple[str, ...] = ()
        self._since_ns = 0

    def due(self, degraded: tuple[str, ...], now_ns: int) -> bytes | None:
        """The text to send now, if any: at most 50 bytes of ASCII."""
        if degraded != self._seen:
            self._seen, self._since_ns = degraded, now_ns
        if degraded == self._told or now_ns - self._since_ns < SETTLED_NS:
            return None
        self._told = degraded
        return fault_text(degraded)


def fault_text(degraded: tuple[str, ...]) -> bytes:
    """`distloc degraded: camera, link`, or `distloc ok`; names that do not fit are dots."""
    if not degraded:
        return b"distloc ok"
    text = f"distloc degraded: {', '.join(degraded)}"
    if len(text) > _MOST_BYTES:
        text = text[: _MOST_BYTES - 3] + "..."
    return text.encode("ascii", "replace")
