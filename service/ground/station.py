"""`distloc ground` and `python -m service.ground.station`: prints what vehicles report and how they are.

Reports go to stdout; who is there, how they are and whether there is a link goes to stderr. A reader of stdout that is
gone, or a full disk under it, ends the process with a line; a full disk under `--out` is told and tried again.
"""

import argparse
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import zenoh

from service.common.process_end import run_process
from service.common.shown import shown
from service.config.load import load_config
from service.config.sections import ConfigError
from service.ground.report_file import ReportFile
from service.ground.subscriber import Subscriber, line_from_report, report_or_fault
from service.ground.watch import VehicleWatch

EXIT_FAULT, EXIT_CONFIG = 1, 78
_POLL_S = 0.5
_POLLS_TO_CONNECT = 4  # before "not connected" is worth a line


class _Printer:
    """Prints from zenoh's threads, one line at a time; `ended` is set where stdout takes no more: `fault` says why."""

    def __init__(self, out: ReportFile | None, out_name: str, ended: threading.Event) -> None:
        self.fault: str | None = None
        self._out, self._out_name, self._ended = out, out_name, ended
        self._watch = VehicleWatch()
        self._lock = threading.Lock()

    def report(self, key: str, payload: bytes) -> None:
        with self._lock:
            if self._out is not None and not isinstance(report_or_fault(payload), str):
                self._keep(self._out, payload)
            self._print(line_from_report(key, payload))  # what was printed is in the file

    def _keep(self, out: ReportFile, payload: bytes) -> None:
        if out.append(payload.replace(b"\n", b" ").replace(b"\r", b" ")):
            fault = out.fault
            said = f"{fault}: reports are only printed" if fault else "reports are written again"
            self._tell([f"{self._out_name}: {said}"])

    def status(self, key: str, payload: bytes) -> None:
        with self._lock:
            self._tell(self._watch.status(key, payload))

    def alive(self, key: str, is_there: bool) -> None:
        with self._lock:
            self._tell(self._watch.alive(key, is_there))

    def linked(self, links: dict[str, bool], is_settled: bool) -> None:
        with self._lock:
            for endpoint, is_connected in links.items():
                if is_connected or is_settled:
                    self._tell(self._watch.link(endpoint, is_connected))

    def _print(self, line: str) -> None:
        if self.fault is not None:
            return
        try:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
        except (OSError, ValueError) as error:
            self.fault = f"stdout: {getattr(error, 'strerror', None) or error}"
            self._ended.set()

    def _tell(self, lines: Sequence[str]) -> None:
        with contextlib.suppress(OSError, ValueError):  # nobody reads it: the reports go on
            for line in lines:
                sys.stderr.write(f"distloc: {line}\n")
            sys.stderr.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """Print until SIGTERM or SIGINT; 1 where no session can be opened or nothing be printed, 78 for a bad key."""
    options = _parser().parse_args(arguments)
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="backslashreplace")  # type: ignore[union-attr]  # a vehicle's name on an ASCII terminal
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    with contextlib.ExitStack() as stack:
        try:
            out = stack.enter_context(ReportFile(options.out)) if options.out else None
            printer = _Printer(out, shown(options.out), ended)
            access = load_config(options.config).zenoh if options.config else None
            subscriber = stack.enter_context(
                Subscriber(options.connect, printer.report, options.listen, access, printer.status, printer.alive)
            )
        except ConfigError as error:
            return _failed(str(error), EXIT_CONFIG)
        except OSError as error:
            return _failed(f"--out {options.out}: {error.strerror}", EXIT_FAULT)
        except zenoh.ZError as error:
            return _failed(f"zenoh: {error}", EXIT_FAULT)
        polls = 0
        while not ended.wait(_POLL_S):  # a signal's handler runs between waits
            polls += 1
            printer.linked(subscriber.linked(), polls >= _POLLS_TO_CONNECT)
    if printer.fault is None:
        return 0
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what still waits in the stream has nowhere to go
    return _failed(printer.fault, EXIT_FAULT)


def _failed(reason: str, status: int) -> int:
    with contextlib.suppress(OSError):
        sys.stderr.write(f"distloc: {shown(' '.join(reason.split()))}\n")
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Prints the reports that vehicles publish over zenoh.")
    parser.add_argument("--connect", action="append", default=[], help="an endpoint, e.g. tcp/127.0.0.1:7447")
    parser.add_argument("--listen", action="append", default=[], help="an endpoint that vehicles connect to")
    parser.add_argument("--config", type=Path, help="a TOML file: its [zenoh] has the certificates and the password")
    parser.add_argument("--out", type=Path, help="append each report as a line of JSON")
    return parser


if __name__ == "__main__":
    run_process(lambda: sys.exit(main()))
