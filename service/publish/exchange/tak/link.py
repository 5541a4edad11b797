"""One TAK link: a thread that connects, sends what is due and connects anew; what it meets holds up nobody else."""

import contextlib
import logging
import random
import threading
from collections import Counter
from collections.abc import Callable

from service.common.shown import shown
from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.fire import SharedFire
from service.publish.exchange.tak.board import Board
from service.publish.exchange.tak.channel import Channel, TakFault, TakLinkError

_log = logging.getLogger(__name__)

RETRY_FIRST_S, RETRY_MAX_S = 1.0, 30.0
_TICK_S = 0.5
_BATCH = 8  # events that are made at once: who tells waits for no more
_CLOSE_S = 3.0

Connect = Callable[[], Channel]


class TakLink:
    """`connect` opens a channel or raises TakLinkError; `clock` gives UTC in seconds. Any thread may tell."""

    def __init__(self, name: str, connect: Connect, board: Board, clock: Callable[[], float]) -> None:
        self.name = name
        self._connect, self._board, self._clock = connect, board, clock
        self._changed = threading.Condition()
        self._is_closing = False
        self._state = "closed"
        self._sent = 0
        self._faults: Counter[TakFault] = Counter()
        self._thread: threading.Thread | None = None

    @property
    def is_connected(self) -> bool:
        return self._state == "connected"

    @property
    def is_lost(self) -> bool:
        """Whether it was tried in vain."""
        return self._state.startswith("retrying")

    @property
    def counters(self) -> dict[str, object]:
        """For the status."""
        with self._changed:
            return {
                "state": self._state,
                "sent": self._sent,
                "fires": self._board.count,
                "left_out": self._board.left_out,
                "without_place": self._board.unplaced,
                "faults": {str(fault): count for fault, count in sorted(self._faults.items())},
            }

    def open(self) -> None:
        """Start the thread; returns at once."""
        if self._thread is None:
            self._is_closing, self._state = False, "connecting"
            self._thread = threading.Thread(target=self._run, name=f"tak {self.name}", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Take the regions back where there is a link; waits 3 s at most, whatever the server does."""
        if self._thread is None:
            return
        with self._changed:
            self._is_closing = True
            self._changed.notify_all()
        self._thread.join(_CLOSE_S)
        self._thread, self._state = None, "closed"

    def tell_fire(self, fire: SharedFire) -> None:
        with self._changed:
            self._board.tell_fire(fire)

    def withdraw(self, uid: str) -> None:
        with self._changed:
            self._board.withdraw(uid)

    def tell_drone(self, drone: SharedDrone) -> None:
        with self._changed:
            self._board.tell_drone(drone)

    def _run(self) -> None:
        wait_s = RETRY_FIRST_S
        while not self._is_closing:
            sent = self._sent
            try:
                with contextlib.closing(self._connect()) as channel:
                    self._serve(channel)
                    return
            except TakLinkError as error:
                self._failed(error.fault, str(error))
            except Exception as error:  # a thread that dies would say nothing any more
                self._failed(TakFault.OTHER, f"{TakFault.OTHER}: {type(error).__name__}: {error}")
            wait_s = RETRY_FIRST_S if self._sent > sent else wait_s
            with self._changed:
                self._changed.wait_for(lambda: self._is_closing, wait_s * random.uniform(0.8, 1.2))
            wait_s = min(RETRY_MAX_S, wait_s * 2.0)

    def _serve(self, channel: Channel) -> None:
        with self._changed:
            self._board.begin()
            self._state = "connected"
        _log.info("TAK: %s is connected", self.name)
        while True:
            channel.poll()
            with self._changed:
                is_closing = self._is_closing
                now_s = self._clock()
                events = self._board.last_words(now_s) if is_closing else self._board.due(now_s, _BATCH)
            for event in events:
                channel.send(event)
                self._sent += 1
            if is_closing:
                return
            with self._changed:
                if len(events) < _BATCH:
                    self._changed.wait_for(lambda: self._is_closing, _TICK_S)

    def _failed(self, fault: TakFault, why: str) -> None:
        with self._changed:
            self._faults[fault] += 1
            state = f"retrying: {shown(why, most=160)}"
            is_news, self._state = state != self._state, state
        if is_news:
            _log.warning("TAK: %s is not connected, trying again: %s", self.name, shown(why, most=160))
