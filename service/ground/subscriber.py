"""Hears every vehicle's reports, status and presence over zenoh; `service.ground.station` prints them."""

from collections.abc import Callable, Sequence

import msgspec
import zenoh
import zenoh.ext

from distloc.backports import Self
from service.common.shown import shown
from service.config.sections import ZenohConfig
from service.publish.wire import Report, decode_report
from service.publish.zenoh import zenoh_config

REPORTS, STATUSES, PRESENCE = "distloc/*/targets/*", "distloc/*/status", "distloc/*/alive"
GET_TIMEOUT_S = 2.0
MAX_REPORT_BYTES = 1_000_000  # ours have 2 kB

OnReport = Callable[[str, bytes], None]
OnPresence = Callable[[str, bool], None]


class Subscriber:
    """Calls `on_report(key, payload)`, on zenoh's threads, for the last report of each target and for every later one.

    `on_status(key, payload)` gets each vehicle's status and `on_alive(key, is_there)` who comes and goes.
    A report may come twice: by the publisher's cache and by the plain `get` that serves where that is missing. The
    callback must not block. `access` gives the certificates and the password. Raises ConfigError where those are wrong,
    and zenoh.ZError on `open` where a listening port is taken.
    """

    def __init__(
        self,
        connect: Sequence[str],
        on_report: OnReport,
        listen: Sequence[str] = (),
        access: ZenohConfig | None = None,
        on_status: OnReport | None = None,
        on_alive: OnPresence | None = None,
    ) -> None:
        settings = msgspec.structs.replace(access or ZenohConfig(), connect=tuple(connect), listen=tuple(listen))
        self._config = zenoh_config(settings)
        self._connect = tuple(connect)
        self._on_report, self._on_status, self._on_alive = on_report, on_status, on_alive
        self._session: zenoh.Session | None = None

    def open(self) -> None:
        """Connect; a peer that is not there yet is tried again behind."""
        self._session = session = zenoh.open(self._config)
        zenoh.ext.declare_advanced_subscriber(
            session,
            REPORTS,
            self._on_sample,
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
        )
        session.get(REPORTS, self._on_reply, timeout=GET_TIMEOUT_S)
        if self._on_status is not None:
            session.declare_subscriber(STATUSES, self._on_status_sample)
        if self._on_alive is not None:
            session.liveliness().declare_subscriber(PRESENCE, self._on_token, history=True)

    @property
    def session(self) -> zenoh.Session:
        """The open session, for what else is to be heard or told over it."""
        assert self._session is not None
        return self._session

    def linked(self) -> dict[str, bool]:
        """Whether there is a link to each endpoint of `connect`, by its port, as a name is an address in the link."""
        links = [] if self._session is None else self._session.info.links()
        ports = {str(link.dst).rpartition(":")[2] for link in links}
        return {one: _port(one) in ports for one in self._connect}

    def close(self) -> None:
        """End the session; no callback comes afterwards."""
        if self._session is not None:
            self._session.close()  # type: ignore[no-untyped-call]
            self._session = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._on_report(str(sample.key_expr), sample.payload.to_bytes())

    def _on_status_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT and self._on_status is not None:
            self._on_status(str(sample.key_expr), sample.payload.to_bytes())

    def _on_token(self, sample: zenoh.Sample) -> None:
        if self._on_alive is not None:
            self._on_alive(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._on_sample(reply.ok)


def _port(endpoint: str) -> str:
    return endpoint.partition("?")[0].partition("#")[0].rpartition(":")[2]


def listen(connect: Sequence[str], on_report: OnReport) -> Subscriber:
    """An open Subscriber; close it or use it in a `with`."""
    subscriber = Subscriber(connect, on_report)
    subscriber.open()
    return subscriber


def report_or_fault(payload: bytes) -> Report | str:
    """The report, or why it is none."""
    if len(payload) > MAX_REPORT_BYTES:
        return f"{len(payload)} bytes, and a report has {MAX_REPORT_BYTES} at most"
    try:
        report = decode_report(payload)
    except (msgspec.MsgspecError, RecursionError) as error:
        return str(error)
    if report.geometry is not None and len(report.geometry.coordinates) >= 2:
        lon_deg, lat_deg = report.geometry.coordinates[:2]
        if not (abs(lon_deg) <= 180.0 and abs(lat_deg) <= 90.0):
            return f"its place is {lat_deg:g}, {lon_deg:g}: not on earth"
    return report


def line_from_report(key: str, payload: bytes) -> str:
    """One line for people; says so where the payload is no report."""
    report = report_or_fault(payload)
    if isinstance(report, str):
        return shown(f"{shown(key, most=200)} no report: {report}")
    said, ellipse = report.properties, report.properties.ellipse95
    where = "nowhere"
    if report.geometry is not None and len(report.geometry.coordinates) >= 2:
        where = f"{report.geometry.coordinates[1]:.5f} {report.geometry.coordinates[0]:.5f}"
    return shown(
        f"{shown(key, most=200)} {said.state} {where} "
        f"+-{_metres(ellipse.semi_major_m)}x{_metres(ellipse.semi_minor_m)} m at {_metres(said.range_m)} m",
        most=2000,
    )


def _metres(value: float | None) -> str:
    return "?" if value is None else f"{value:.0f}"
