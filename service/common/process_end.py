"""How a process of ours ends: without the interpreter taking itself down, once everything of ours is closed.

zenoh's threads, written in Rust, may still drop a callback of ours then; one that enters Python while it is being taken
down is unwound by force, and aborts the process in place of its exit status.
"""

import atexit
import os
import sys
from collections.abc import Callable
from typing import TextIO


def run_process(main: Callable[[], object]) -> None:
    """Call `main` and end the process with its SystemExit's status, 0 if it returns, 1 if it raises anything else.

    Threads are waited for and what is registered with atexit after this call is run, as always.
    """
    status = 1

    def leave() -> None:
        lost = [_is_lost(stream) for stream in (sys.stdout, sys.stderr)]
        os._exit(status or int(any(lost)))

    atexit.register(leave)
    try:
        main()
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
        raise


def _is_lost(stream: TextIO) -> bool:
    """Whether what waits to be written cannot be, on a full disk, say; where nobody reads on nothing is lost."""
    try:
        stream.flush()
    except (BrokenPipeError, ValueError):  # ValueError: it was closed
        return False
    except OSError:
        return True
    return False
