"""Hears every vehicle's reports over zenoh; `python -m service.ground.subscriber` prints them. For `distloc ground`."""

import argparse
import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Self

import msgspec
import zenoh
import zenoh.ext

from service.common.process_end import run_process
from service.config.sections import ConfigError, ZenohConfig, load_config
from service.publish.wire import decode_report
from service.publish.zenoh import zenoh_config

REPORTS = "distloc/*/targets/*"
GET_TIMEOUT_S = 2.0

OnReport = Callable[[str, bytes], None]


class Subscriber:
    """Calls `on_report(key, payload)`, on zenoh's threads, for the last report of each target and for every later one.

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
    ) -> None:
        settings = msgspec.structs.replace(access or ZenohConfig(), connect=tuple(connect), listen=tuple(listen))
        self._config = zenoh_config(settings)
        self._on_report = on_report
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

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._on_sample(reply.ok)


def listen(connect: Sequence[str], on_report: OnReport) -> Subscriber:
    """An open Subscriber; close it or use it in a `with`."""
    subscriber = Subscriber(connect, on_report)
    subscriber.open()
    return subscriber


def line_from_report(key: str, payload: bytes) -> str:
    """One line for people; says so where the payload is no report."""
    try:
        report = decode_report(payload)
    except (msgspec.MsgspecError, RecursionError) as error:
        return f"{key} no report: {error}"
    said, ellipse = report.properties, report.properties.ellipse95
    where = "nowhere"
    if report.geometry is not None and len(report.geometry.coordinates) >= 2:
        where = f"{report.geometry.coordinates[1]:.5f} {report.geometry.coordinates[0]:.5f}"
    return (
        f"{key} {said.state} {where} +-{_metres(ellipse.semi_major_m)}x{_metres(ellipse.semi_minor_m)} m"
        f" at {_metres(said.range_m)} m"
    )


def _metres(value: float | None) -> str:
    return "?" if value is None else f"{value:.0f}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print reports until SIGTERM or SIGINT; 1 where the session cannot be opened."""
    parser = argparse.ArgumentParser(description="Prints the reports that vehicles publish over zenoh.")
    parser.add_argument("--connect", action="append", default=[], help="an endpoint, e.g. tcp/127.0.0.1:7447")
    parser.add_argument("--listen", action="append", default=[], help="an endpoint that vehicles connect to")
    parser.add_argument("--config", type=Path, help="a TOML file: its [zenoh] has the certificates and the password")
    parser.add_argument("--out", type=Path, help="append each report as a line of JSON")
    options = parser.parse_args(arguments)
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    one_at_a_time = threading.Lock()
    with contextlib.ExitStack() as stack:
        out = stack.enter_context(options.out.open("ab")) if options.out else None

        def on_report(key: str, payload: bytes) -> None:
            with one_at_a_time:
                sys.stdout.write(line_from_report(key, payload) + "\n")
                sys.stdout.flush()
                if out is not None:
                    out.write(payload.replace(b"\n", b" ") + b"\n")
                    out.flush()

        try:
            access = load_config(options.config).zenoh if options.config else None
            stack.enter_context(Subscriber(options.connect, on_report, options.listen, access))
        except ConfigError as error:
            sys.stderr.write(f"distloc: {error}\n")
            return 78
        except zenoh.ZError as error:
            sys.stderr.write(f"zenoh: {error}\n")
            return 1
        while not ended.wait(0.5):
            pass  # a signal's handler runs between waits
    return 0


if __name__ == "__main__":
    run_process(lambda: sys.exit(main()))
