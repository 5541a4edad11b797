"""One run of the camera's command, seen from the service: its pipes, how it ended, and that nothing of it is left."""

import fcntl
import os
import secrets
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

_KEEPER = Path(__file__).with_name("keeper.py")
_PIPE_BYTES = 1 << 20  # what an unprivileged process may have: a full HD frame in 6 reads and not 96
_USUAL_PIPE_BYTES = 1 << 16
_MOST_SAID = 8192
_END_S = 4.0  # the keeper ends all within 3
_NOTICE_S = 2.0  # that one has ended by itself: its output closes a little before
_WORDS = 3  # lines
_FLOOD = b"flood\n"
_MARK = "DISTLOC_RUN"  # in the environment of all that comes of a run


@dataclass(frozen=True, slots=True)
class Ended:
    """How a run ended, in words: `why` begins with a verb; `words` are the last of its error output."""

    why: str
    words: str = ""
    is_flood: bool = False
    is_started: bool = True
    is_kept_no_more: bool = False  # nobody has ended what came of it

    def with_words(self, what: str) -> str:
        """`what` happened, and what it said itself."""
        if not self.is_started:
            return what
        flood = "; it floods its error output, make it quieter" if self.is_flood else ""
        return what + (f'; its last words: "{self.words}"' if self.words else "; it said nothing") + flood


class Run:
    """A started command.

    `frames` and `times` (None without a second channel) are read by the owner, who calls `hear` when `said` can be
    read, and `end` in any case.
    """

    def __init__(self, command: tuple[str, ...], has_times: bool) -> None:
        made = list[int]()
        try:
            self.frames, frames = self._pipe(made)
            self.times: int | None = None
            times = -1
            if has_times:
                self.times, times = self._pipe(made)
            lifeline, self._lifeline = self._pipe(made)
            self.said, saying = self._pipe(made)
            self._mark = f"{_MARK}={secrets.token_hex(8)}"
            self._keeper = subprocess.Popen(
                [sys.executable, "-I", "-S", str(_KEEPER), str(frames), str(times), *command],
                stdin=lifeline,
                stdout=saying,
                pass_fds=[frames, *([times] if has_times else [])],
                start_new_session=True,
                env=os.environ | dict([self._mark.split("=")]),
            )
        except BaseException:
            for fd in made:
                os.close(fd)
            raise
        self._heard = b""
        self.is_over = False
        for fd in (frames, times, lifeline, saying):
            if fd >= 0:
                os.close(fd)
        self.pipe_bytes = _USUAL_PIPE_BYTES
        with suppress(OSError, AttributeError):  # beyond what this user may have: it works with less
            self.pipe_bytes = fcntl.fcntl(self.frames, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        for reading in (self.frames, self.said, *([] if self.times is None else [self.times])):
            os.set_blocking(reading, False)

    @staticmethod
    def _pipe(made: list[int]) -> tuple[int, int]:
        ends = os.pipe()
        made += ends
        return ends

    @property
    def is_flood(self) -> bool:
        """Whether its error output came too fast."""
        return self._heard.startswith(_FLOOD)

    def hear(self) -> bool:
        """Take what the keeper says; False once it says nothing more: `is_over`."""
        more = os.read(self.said, _MOST_SAID)
        self._heard = (self._heard + more)[:_MOST_SAID]
        self.is_over = not more
        return not self.is_over

    def end(self, has_ended: bool = False) -> Ended:
        """End all of it and let go of it, which may take some seconds; `has_ended`: it closed its output by itself."""
        if has_ended:
            self._hear_out(_NOTICE_S)
        stays = has_ended and not self.is_over
        os.close(self._lifeline)
        for fd in (self.frames, self.times):
            if fd is not None:
                os.close(fd)
        self._hear_out(_END_S)
        with suppress(subprocess.TimeoutExpired):
            self._keeper.wait(0.5)
        self._keeper.kill()
        self._keeper.wait()
        os.close(self.said)
        ended = _ended(self._heard)
        if ended.is_kept_no_more:
            _end_marked(self._mark.encode())
        return replace(ended, why="closed its standard output and stayed") if stays else ended

    def _hear_out(self, timeout_s: float) -> None:
        poll = select.poll()
        poll.register(self.said, select.POLLIN)
        while not self.is_over and poll.poll(timeout_s * 1000.0):
            self.hear()


def _ended(said: bytes) -> Ended:
    """The keeper's words as ours."""
    is_flood = said.startswith(_FLOOD)
    line, _, words = said.removeprefix(_FLOOD).partition(b"\n")
    kind, _, rest = line.decode(errors="replace").partition(" ")
    if kind == "failed":
        return Ended(f"cannot be started: {rest}", is_started=False)
    if kind != "ended":
        why = "was lost: the process that keeps it is gone, or it does not let itself be ended"
        return Ended(why, "", is_flood, is_kept_no_more=True)
    status, left = (int(one) for one in rest.split())
    behind = f" and left {left} process{'es' if left > 1 else ''} behind, ended too" if left else ""
    lines = [one.strip() for one in words.decode(errors="replace").splitlines() if one.strip()]
    return Ended(_how(status) + behind, " | ".join(lines[-_WORDS:])[-400:], is_flood)


def _end_marked(mark: bytes) -> None:
    """Kill each process with this in its environment, until there is none; one that hangs in a driver stays."""
    end_s = time.monotonic() + _END_S
    while (pids := _marked(mark)) and time.monotonic() < end_s:
        for pid in pids:
            with suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.02)


def _marked(mark: bytes) -> list[int]:
    pids = []
    for name in filter(str.isdecimal, os.listdir("/proc")):
        with suppress(OSError):  # it has ended, or is another user's
            if mark in Path(f"/proc/{name}/environ").read_bytes().split(b"\0"):
                pids.append(int(name))
    return pids


def _how(status: int) -> str:
    if status < 0:
        return "does not let itself be ended: a device that hangs"
    if os.WIFSIGNALED(status):
        with suppress(ValueError):
            return f"ended by {signal.Signals(os.WTERMSIG(status)).name}"
        return f"ended by signal {os.WTERMSIG(status)}"
    return f"ended with status {os.waitstatus_to_exitcode(status)}"
