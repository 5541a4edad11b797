"""The process between the service and the command: starts it, drains its error output and ends all that came of it.

`run.py` starts it by its path, as `python -I -S keeper.py FRAMES TIMES COMMAND...`, so it imports nothing of ours;
FRAMES and TIMES are descriptors (TIMES -1: none) that become the command's 1 and 3. Its standard input is its lifeline:
it ends everything once that closes, as it does when the service is killed. On its standard output it says, a line each,
`flood` when the error output came too fast, `failed ERROR` where the command could not be started, and at the end
`ended STATUS LEFT`: the wait status (-1: it could not be ended) and how many other processes it had left behind; then
the last words.
"""

import ctypes
import fcntl
import os
import select
import signal
import sys
import time
from contextlib import suppress

_GRACE_S = 1.0  # to end by SIGTERM
_PATIENCE_S = 2.0  # to end by SIGKILL: what hangs in a driver does not
_LAST_WORDS = 4096  # bytes
_MOST_A_SECOND = 16_000_000  # bytes of error output: draining them takes a hundredth of a core
_FLOOD = 1_000_000  # bytes in a second are told
_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36
_TIMES_FD = 3


class Keeper:
    """One run of a command."""

    def __init__(self, frames: int, times: int, command: list[str]) -> None:
        self._command = command
        self._status: int | None = None
        self._words = bytearray()
        self._second, self._drained, self._is_flood = 0.0, 0, False
        self._is_stopping = self._is_alone = False  # told to end it while it ran; the lifeline is closed
        self._wake, wake = os.pipe()
        for fd in (self._wake, wake):
            os.set_blocking(fd, False)
        signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        signal.signal(signal.SIGTERM, self._stop)
        _set(_PR_SET_CHILD_SUBREAPER, 1)  # what forks twice stays ours
        self._errors, errors = os.pipe()
        failed, failing = os.pipe()
        self._child = os.fork()
        if not self._child:
            self._become(frames, times, errors, failing)
        for fd in (frames, times, errors, failing):
            if fd >= 0:
                os.close(fd)
        with os.fdopen(failed, "rb") as said:
            self._failure = said.read()  # empty once the command has taken the child's place
        os.set_blocking(self._errors, False)

    def run(self) -> None:
        """Wait for its end or the lifeline's, end what is left, say how it was."""
        if self._failure:
            os.waitpid(self._child, 0)
            _say(b"failed " + self._failure + b"\n")
            return
        while self._status is None and not self._is_stopping:
            self._wait(None)
        left = self._end()
        self._drain()
        status = -1 if self._status is None else self._status
        _say(b"ended %d %d\n" % (status, left) + bytes(self._words))

    def _stop(self, *_: object) -> None:
        self._is_stopping = self._status is None

    def _become(self, frames: int, times: int, errors: int, failing: int) -> None:
        """In the child: the command's own descriptors, and the command."""
        try:
            _set(_PR_SET_PDEATHSIG, signal.SIGKILL)  # it outlives no keeper
            signal.set_wakeup_fd(-1)
            for number in (signal.SIGPIPE, signal.SIGXFSZ, signal.SIGCHLD, signal.SIGTERM):
                signal.signal(number, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_SETMASK, [])
            # above all that is to be filled, so that none overwrites another
            frames, errors, failing = (_above(fd) for fd in (frames, errors, failing))
            times = _above(times) if times >= 0 else -1
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(frames, 1)
            os.dup2(errors, 2)
            if times >= 0:
                os.dup2(times, _TIMES_FD)
            else:
                with suppress(OSError):
                    os.close(_TIMES_FD)
            os.closerange(_TIMES_FD + 1, failing)
            os.closerange(failing + 1, 256)
            os.execvp(self._command[0], self._command)
        except BaseException as error:
            os.write(failing, str(getattr(error, "strerror", None) or error).encode())
        os._exit(127)

    def _wait(self, timeout_s: float | None) -> None:
        """Until something happens: a child ends, error output comes, the lifeline closes."""
        watched = [self._wake, *([] if self._is_alone else [0])]
        if self._errors >= 0 and self._may_drain():
            watched.append(self._errors)
        elif self._errors >= 0:
            timeout_s = min(1.0 if timeout_s is None else timeout_s, 0.1)
        ready = select.select(watched, [], [], timeout_s)[0]
        with suppress(BlockingIOError):
            os.read(self._wake, 64)
        self._reap()
        if 0 in ready and not os.read(0, 64):
            self._is_alone = True
            self._is_stopping = self._status is None
        if self._errors in ready:
            self._drain()

    def _reap(self) -> None:
        with suppress(ChildProcessError):
            while True:
                pid, status = os.waitpid(-1, os.WNOHANG)
                if not pid:
                    return
                if pid == self._child:
                    self._status = status

    def _may_drain(self) -> bool:
        now_s = time.monotonic()
        if now_s - self._second >= 1.0:
            self._second, self._drained = now_s, 0
        return self._drained < _MOST_A_SECOND

    def _drain(self) -> None:
        """Take what there is of the error output, at most 64 KiB, and keep its end."""
        try:
            said = os.read(self._errors, 65536) if self._errors >= 0 else b""
        except BlockingIOError:
            return
        if not said and self._errors >= 0:
            os.close(self._errors)
            self._errors = -1
        if not self._is_stopping:  # what it says of being ended tells nothing
            self._words += said
        del self._words[:-_LAST_WORDS]
        self._drained += len(said)
        if self._drained > _FLOOD and not self._is_flood:
            self._is_flood = True
            _say(b"flood\n")

    def _end(self) -> int:
        """End all that came of the command; how many there were beside it when it had ended."""
        left = len(_descendants())
        for number, patience_s in ((signal.SIGTERM, _GRACE_S), (signal.SIGKILL, _PATIENCE_S)):
            end_s, told = time.monotonic() + patience_s, set[int]()
            while there := _descendants():
                if time.monotonic() > end_s:
                    break
                for pid in there:
                    if number == signal.SIGKILL or pid not in told:
                        with suppress(OSError):
                            os.kill(pid, number)
                told |= there
                self._wait(0.02)
        self._reap()
        return 0 if self._is_stopping else left


def _set(option: int, value: int) -> None:
    """Linux's prctl; without it what forks twice gets away."""
    with suppress(AttributeError, OSError, MemoryError):
        ctypes.CDLL(None).prctl(option, *(ctypes.c_ulong(one) for one in (value, 0, 0, 0)))


def _above(fd: int) -> int:
    """Moved beyond the descriptors that the command gets, and not inherited."""
    moved = fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 64)
    os.close(fd)
    return moved


def _descendants() -> set[int]:
    """Processes that came of this one and live, by /proc: as orphans come to us, all are below."""
    parents = dict[int, int]()
    for name in os.listdir("/proc"):
        if name.isdecimal():
            with suppress(OSError, ValueError, IndexError):
                with open(f"/proc/{name}/stat", "rb") as stat:
                    state, parent = stat.read().rpartition(b")")[2].split()[:2]
                if state not in b"ZX":
                    parents[int(name)] = int(parent)
    ours = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in ours} - ours:
        ours |= more
    return ours - {os.getpid()}


def _say(line: bytes) -> None:
    with suppress(OSError):  # the service was killed: nobody hears
        os.write(1, line)


if __name__ == "__main__":
    Keeper(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]).run()
