"""The service's health: ages, reasons and counters for the status, and the watchdog fed by the pipeline's progress."""

import time
from typing import TYPE_CHECKING

from service.systemd_notify import notify
from service.wire import StatusReport, utc_text

if TYPE_CHECKING:
    from service.app import App

_STALE_NS = 3_000_000_000
_STUCK_NS = 20_000_000_000


class PipelineHealth:
    """Reads the app's parts; owns only the ages."""

    def __init__(self, app: "App") -> None:
        self._app = app
        self._heard_ns: int | None = None
        self._localised_ns: int | None = None
        self._started_ns = time.monotonic_ns()

    def frame_heard(self, stamp_ns: int) -> None:
        """A frame came from the camera."""
        self._heard_ns = stamp_ns

    def frame_localised(self, now_ns: int) -> None:
        """A frame went through the localise stage."""
        self._localised_ns = now_ns

    def degraded(self, now_ns: int) -> tuple[str, ...]:
        """Names of what does not work as it should."""
        names = list(self._app.autopilot.degraded(now_ns))
        has_camera = self._app.config.camera.source.kind != "none" or self._heard_ns is not None
        if has_camera and (self._heard_ns is None or now_ns - self._heard_ns > _STALE_NS):
            names.append("camera")
        return tuple(sorted(set(names)))

    def report(self, now_ns: int) -> StatusReport:
        """The status message."""
        degraded = self.degraded(now_ns)
        time_utc_s, _ = self._app.autopilot.utc_s(now_ns)
        return StatusReport(
            vehicle=self._app.config.vehicle,
            time_utc=utc_text(time_utc_s),
            state="degraded" if degraded else "ok",
            degraded=list(degraded),
            counters=self._app.counters(),
        )

    def feed_watchdog(self, now_ns: int) -> None:
        """Tell systemd that the service lives, unless frames and poses come but none went through for 20 s."""
        has_pose = self._app.vehicle_state(now_ns) is not None
        is_fed = self._heard_ns is not None and now_ns - self._heard_ns < _STALE_NS and has_pose
        last_ns = self._localised_ns or self._started_ns
        if not (is_fed and now_ns - last_ns > _STUCK_NS):
            notify("WATCHDOG=1")
