"""Puts a simulated autopilot on UDP sockets in real time; its process and `distloc autopilot` call it."""

import heapq
import itertools
import select
import socket
import time
from collections.abc import Sequence
from typing import Protocol

_LONGEST_WAIT_S = 0.0025  # one loop of ArduCopter


class Flying(Protocol):
    """What is simulated, by the seconds since the scenario's start."""

    def receive(self, data: bytes, t_s: float) -> None:
        """Take bytes that were put on a link."""

    def due(self, t_s: float) -> list[tuple[float, bytes]]:
        """Frames packed up to then, each with the time at which it arrives."""
        ...


def serve(
    autopilot: Flying, links: Sequence[socket.socket], start_monotonic_ns: int, duration_s: float, stop: socket.socket
) -> None:
    """Fly on connected, non-blocking UDP sockets until the duration is over or `stop` is readable.

    Each link gets what the autopilot says and, as an autopilot routes, what comes over the others.
    """
    pending: list[tuple[float, int, bytes]] = []
    order = itertools.count()
    while (t_s := (time.monotonic_ns() - start_monotonic_ns) * 1e-9) < duration_s:
        for deliver_s, frame in autopilot.due(t_s):
            heapq.heappush(pending, (deliver_s, next(order), frame))
        while pending and pending[0][0] <= t_s:
            frame = heapq.heappop(pending)[2]
            for link in links:
                _try_send(link, frame)
        until_delivery_s = pending[0][0] - t_s if pending else _LONGEST_WAIT_S
        readable, _, _ = select.select([*links, stop], [], [], min(max(until_delivery_s, 0.0), _LONGEST_WAIT_S))
        if stop in readable:
            return
        for link in links:
            if link in readable and (data := _try_receive(link)):
                autopilot.receive(data, (time.monotonic_ns() - start_monotonic_ns) * 1e-9)
                for other in links:
                    if other is not link:
                        _try_send(other, data)


def _try_send(link: socket.socket, frame: bytes) -> None:
    try:
        link.send(frame)
    except (ConnectionRefusedError, BlockingIOError):
        return  # nobody listens yet, or the buffer is full: a datagram is lost, as on a radio


def _try_receive(link: socket.socket) -> bytes:
    try:
        return link.recv(65535)
    except (ConnectionRefusedError, BlockingIOError):
        return b""
