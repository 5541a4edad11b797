"""Feeds systemd's watchdog while whatever has work gets it done; the composition root calls it.

No camera and no autopilot are no stall: a restart would not bring them back, and it would lose the targets.
"""

import logging
from collections.abc import Callable, Sequence

from service.flight.systemd_notify import notify
from service.mavlink.link import Link

_log = logging.getLogger(__name__)

FRAME_LIMIT_NS = 20_000_000_000
FAILING_AGE_NS = 20_000_000_000  # a failure older than this tells of no frame that fails now
LINK_LIMIT_NS = 60_000_000_000  # a name server that is away holds up a connect for 30 s


class Watchdog:
    """Follows the frame that waits longest and each link's own task; `notify` sends to systemd."""

    def __init__(self, links: Sequence[Link], notify: Callable[..., bool] = notify) -> None:
        self._links = links
        self._notify = notify
        self._waiting_ns: int | None = None
        self._failing_ns: int | None = None
        self._failed_ns = 0
        self._told: tuple[str, ...] = ()

    def frame_waits(self, now_ns: int) -> None:
        """A frame came, or was taken up: from now on it has to get through."""
        if self._waiting_ns is None:
            self._waiting_ns = now_ns

    def frame_done(self) -> None:
        """A frame got through."""
        self._waiting_ns = self._failing_ns = None

    def frame_refused(self) -> None:
        """A frame was refused for its pose: that tells nothing of the segmenter."""
        self._waiting_ns = None

    def frame_failed(self, now_ns: int) -> None:
        """The segmenter or the localizer failed on a frame; a restart mends a GPU that fails on all."""
        if self._failing_ns is None or now_ns - self._failed_ns > FAILING_AGE_NS:
            self._failing_ns = now_ns
        self._failed_ns = now_ns
        self._waiting_ns = None

    def stalled(self, now_ns: int) -> tuple[str, ...]:
        """Names of what has work and does not get it done: "localise", "segmenter", a link's URL."""
        names = [link.name for link in self._links if now_ns - link.beat_ns > LINK_LIMIT_NS]
        if self._waiting_ns is not None and now_ns - self._waiting_ns > FRAME_LIMIT_NS:
            names.append("localise")
        still_fails = now_ns - self._failed_ns < FAILING_AGE_NS
        if self._failing_ns is not None and still_fails and now_ns - self._failing_ns > FRAME_LIMIT_NS:
            names.append("segmenter")
        return tuple(names)

    def feed(self, now_ns: int, status: str) -> None:
        """Tell systemd that the service lives, unless something is stalled; `status` is what `systemctl` shows."""
        stalled = self.stalled(now_ns)
        if stalled:
            self._notify(f"STATUS=stalled: {', '.join(stalled)}")
        else:
            self._notify("WATCHDOG=1", f"STATUS={status}")
        if stalled and stalled != self._told:
            _log.error("stalled: %s; the watchdog is not fed", ", ".join(stalled))
        self._told = stalled
