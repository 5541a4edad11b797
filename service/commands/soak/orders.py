"""Standard input of a child process: orders as lines of JSON, and its end when the parent is gone, however it went."""

import json
import os
import sys
import threading
from collections.abc import Callable
from typing import Any

_GRACE_S = 18.0  # the parent waits for 20


def follow(on_order: Callable[[dict[str, Any]], None], on_end: Callable[[], None]) -> None:
    """Read in a thread; at the end call `on_end`, and if the process still runs some seconds later, end it."""

    def read() -> None:
        try:
            for line in sys.stdin:
                on_order(json.loads(line))
        finally:  # also after a line that was torn as the parent died
            on_end()
        threading.Event().wait(_GRACE_S)
        os._exit(1)

    threading.Thread(target=read, name="orders", daemon=True).start()
