"""The service's health: ages, reasons and counters for the status."""

from typing import TYPE_CHECKING

from service.publish.wire import StatusReport, utc_text

if TYPE_CHECKING:
    from service.flight.app import App

_STALE_NS = 3_000_000_000


class PipelineHealth:
    """Reads the app's parts; owns only the ages."""

    def __init__(self, app: "App") -> None:
        self._app = app
        self._heard_ns: int | None = None
        self._given_ns: int | None = None

    def frame_heard(self, stamp_ns: int) -> None:
        """A frame came from the camera."""
        self._heard_ns = stamp_ns

    def frame_given(self, now_ns: int) -> None:
        """A frame is handed to the localise stage."""
        if self._given_ns is None:
            self._given_ns = now_ns

    def frame_unusable(self) -> None:
        """One came that tells nothing: the segmenter has nothing to do."""
        self._given_ns = None

    def mask_made(self) -> None:
        """The stage made a mask of one."""
        self._given_ns = None

    def degraded(self, now_ns: int) -> tuple[str, ...]:
        """Names of what does not work as it should; docs/faults.md has them all."""
        names = list(self._app.autopilot.degraded(now_ns))
        if self._app.has_camera and (self._heard_ns is None or now_ns - self._heard_ns > _STALE_NS):
            names.append("camera")
        elif self._app.blindness.is_blind():
            names.append("camera_blind")
        elif self._app.freeze.is_frozen():
            names.append("camera_frozen")
        if self._given_ns is not None and now_ns - self._given_ns > _STALE_NS:
            names.append("segmenter")  # it fails, floods or takes this long
        names += [name for name, part in (("recorder", self._app.recorder), ("zenoh", self._app.zenoh)) if part.is_lost]
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
