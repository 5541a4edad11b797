"""Progress on a terminal's stderr while long work runs; nothing where nobody looks."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from service.common.shown import shown


@contextmanager
def log_progress(title: str) -> Iterator[Callable[[int], None]]:
    """For work along a log: call it with the log's stamp in nanoseconds."""
    if not sys.stderr.isatty():
        yield lambda stamp_ns: None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress, TextColumn, TimeElapsedColumn

    title = escape(shown(title))
    first: list[int] = []
    with Progress(TextColumn("{task.description}"), TimeElapsedColumn(), console=Console(stderr=True)) as bar:
        task = bar.add_task(title)

        def advance(stamp_ns: int) -> None:
            if not first:
                first.append(stamp_ns)
            bar.update(task, description=f"{title}  {(stamp_ns - first[0]) / 1e9:6.1f} s of the log")

        yield advance


@contextmanager
def count_progress(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """For work in `total` like parts: call it with the number done."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    times = (TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, *times, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def time_progress(title: str, total_s: float) -> Iterator[Callable[[float, str], None]]:
    """For work that lasts a known time: call it with the seconds done and a few words on how it goes."""
    if not sys.stderr.isatty():
        yield lambda done_s, text: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn(title), BarColumn(20), TextColumn("{task.description}"))
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("", total=total_s)
        yield lambda done_s, text: bar.update(task, completed=done_s, description=text)
