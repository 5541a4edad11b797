"""A zenoh subscriber in another process, with the time of each report that it hears."""

import multiprocessing
import time
from multiprocessing.connection import Connection

from distloc.backports import Self
from service.ground.subscriber import Subscriber
from service.publish.wire import decode_report

_WAIT_S = 30.0


class OtherProcess:
    """A subscriber in a process of its own; the clock is the machine's, which all its processes share."""

    def __init__(self, endpoint: str) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_listen, args=(theirs, endpoint), daemon=True)
        self._process.start()
        theirs.close()

    def is_ready(self) -> bool:
        """Whether it has told that its session is open; True once only."""
        return self._pipe.poll() and bool(self._pipe.recv())

    def heard_ns(self) -> dict[int, int]:
        """CLOCK_MONOTONIC at which each report, by its `seq`, was first heard; the process ends."""
        self._pipe.send(None)
        heard: dict[int, int] = self._pipe.recv() if self._pipe.poll(_WAIT_S) else {}
        return heard

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()


def _listen(pipe: Connection, endpoint: str) -> None:
    heard: list[tuple[int, bytes]] = []

    def on_report(key: str, payload: bytes) -> None:
        heard.append((time.monotonic_ns(), payload))

    with Subscriber([endpoint], on_report):
        pipe.send(True)
        pipe.recv()
    first_ns: dict[int, int] = {}
    for stamp_ns, payload in heard:
        first_ns.setdefault(decode_report(payload).properties.seq, stamp_ns)
    pipe.send(first_ns)
