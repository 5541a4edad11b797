"""`distloc soak`: flies, says how it goes, writes soak.json, soak.csv and soak.png."""

import contextlib
import logging
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np

from service.commands.errors import MissingExtraError
from service.commands.progress import time_progress
from service.commands.soak.flight import Flight, Settings
from service.commands.soak.judging.measuring import Now
from service.commands.soak.judging.result import SoakResult
from service.commands.soak.judging.series import Series
from service.commands.study.files import load_plots, prepared
from service.common.files import write_whole


def run_soak(out: Path, settings: Settings, say: Callable[[str], None]) -> SoakResult:
    """Fly and write; SIGINT and SIGTERM end the flight early, and what there is then is written.

    Raises SoakError where there is nothing to write, OutputError for a folder that cannot be written.
    """
    prepared(out)
    logging.getLogger().setLevel(logging.WARNING)
    duration_s = settings.minutes * 60.0
    with _until_signal() as stop, time_progress("soak", duration_s) as progress:

        def tell(now: Now) -> None:
            progress(now.t_s, _line(now, duration_s))

        with Flight(settings, out) as flight:
            result = flight.fly(stop, tell)
    _write(out, result, flight.series, say)
    for limit in result.verdict.limits:
        measured = "not measured" if limit.measured is None else f"{limit.measured:g}"
        say(f"{'ok' if limit.is_met else 'FAIL':4} {limit.name}: {measured} (limit {limit.limit:g})")
    counts = result.counts
    if (
        counts.frames_sent + counts.frames_late < 0.95 * counts.frames_wanted
        or counts.frames_late > 0.05 * counts.frames_wanted
    ):
        reached_hz = counts.frames_sent / (result.minutes * 60.0)
        say(f"this machine draws no more than {reached_hz:.1f} frames a second beside the service")
    say(f"soak {'passed' if result.verdict.passed else 'failed'} after {result.minutes:.1f} minutes")
    return result


def _write(out: Path, result: SoakResult, series: Series, say: Callable[[str], None]) -> None:
    write_whole(out / "soak.json", msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n")
    write_whole(out / "soak.csv", series.csv())
    written = "soak.json, soak.csv"
    try:
        load_plots()
    except MissingExtraError:
        (out / "soak.png").unlink(missing_ok=True)
        say("no soak.png: it is drawn with matplotlib, which is not installed: pip install '.[study]'")
    else:
        from service.commands.soak.judging.plot import soak_png

        write_whole(out / "soak.png", soak_png(result, series))
        written += ", soak.png"
    say(f"wrote {out}/{written}")


def _line(now: Now, duration_s: float) -> str:
    left_s = max(duration_s - now.t_s, 0.0)
    latency = f"latency {now.latency.p95_ms:.0f} ms" if np.isfinite(now.latency.p95_ms) else "no report"
    fault = f", {now.fault}" if now.fault else ""
    return f"{left_s // 60:.0f} min {left_s % 60:02.0f} s left, {now.memory_mb:.0f} MB, {latency}{fault}"


@contextlib.contextmanager
def _until_signal() -> Iterator[threading.Event]:
    """An event that SIGINT and SIGTERM set meanwhile."""
    stop = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: stop.set()) for number in numbers]
    try:
        yield stop
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
