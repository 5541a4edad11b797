"""The service's side of the process that has the GPU: starts it, waits for it, has it run an input, ends it."""

import contextlib
import json
import mmap
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
from multiprocessing import Pipe

import msgspec
import numpy as np
from numpy.typing import NDArray

from service.segmenters.accelerator.protocol import (
    Failed,
    Gave,
    Given,
    Plan,
    Ready,
    Word,
    input_bytes,
    input_in,
    receive,
    receive_array,
    send,
)

BUILD_LIMIT_S = 1200.0  # of the first run, in which an engine may be built
RUN_LIMIT_S = 10.0  # well under the watchdog's 20: the frame is then run on the CPU
_END_S = 5.0
_MOST_WORDS = 20_000  # bytes of what it wrote before it ended that are looked at
_BEGIN = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from service.segmenters.accelerator.worker import main; main(int(sys.argv[2]), int(sys.argv[3]))"
)
_LACKS = re.compile(r"(?:^|[\s/])(lib[^\s/]+\.so[^\s:]*): cannot open shared object file")
_TOLD = re.compile(r"(?:FAIL : |[Ee]rror:? )(.+)")


class AcceleratorError(Exception):
    """It cannot be opened, or it failed: one line."""


class GpuProcess:
    """Has no say over the service: that it hangs, crashes or is killed is an AcceleratorError.

    `kill` may be called from any thread; all else from one at a time.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._words = tempfile.TemporaryFile()  # noqa: SIM115  # lives as long as the process
        self._scratch = tempfile.TemporaryDirectory(prefix="distloc-")  # what it leaves where it is killed goes as well
        self._connection, theirs = Pipe()
        shared = os.memfd_create("distloc-input")
        try:
            os.ftruncate(shared, input_bytes(plan))
            self._memory = mmap.mmap(shared, input_bytes(plan))
            handles = (theirs.fileno(), shared)
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-c", _BEGIN, json.dumps(sys.path), *map(str, handles)],
                stdin=subprocess.PIPE,  # it ends with us: this end closes whatever becomes of us
                stdout=self._words,
                stderr=self._words,
                pass_fds=handles,
                env=os.environ | {"TMPDIR": self._scratch.name},
            )
        finally:
            theirs.close()
            os.close(shared)
        self.pid = self._process.pid

    def wait_ready(self) -> Ready:
        """What it opened, once it has run; minutes where an engine is built."""
        with self._limited(BUILD_LIMIT_S):
            send(self._connection, self._plan)
            answer = receive(self._connection)
        if isinstance(answer, Ready):
            return answer
        raise AcceleratorError(self._with_words(_why(answer)))

    def run(self, values: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """The plan's outputs for an input of one of its shapes."""
        with self._limited(RUN_LIMIT_S):
            input_in(self._memory, values.shape)[:] = values
            send(self._connection, Given(values.shape))
            answer = receive(self._connection)
            if isinstance(answer, Gave):
                return [receive_array(self._connection, shape) for shape in answer.shapes]
        raise AcceleratorError(_why(answer))

    def kill(self) -> None:
        """End it now; whoever waits for it gets an AcceleratorError."""
        self._process.kill()

    def close(self) -> None:
        """End it and let go of what it held."""
        self.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):  # one that hangs inside the driver is left to the kernel
            self._process.wait(_END_S)
        for held in (self._connection, self._words, self._memory, self._process.stdin):
            with contextlib.suppress(OSError, BufferError):
                if held is not None:
                    held.close()
        with contextlib.suppress(OSError):
            self._scratch.cleanup()

    @contextlib.contextmanager
    def _limited(self, limit_s: float):  # type: ignore[no-untyped-def]
        """Kill it where it takes longer; its end is told as an AcceleratorError."""
        is_late = threading.Event()

        def end() -> None:
            is_late.set()
            self.kill()

        timer = threading.Timer(limit_s, end)
        timer.daemon = True
        timer.start()
        try:
            yield
        except (EOFError, OSError, ValueError, msgspec.DecodeError) as error:
            said = f"no answer within {limit_s:g} s" if is_late.is_set() else self._with_words(self._end())
            raise AcceleratorError(said) from error
        finally:
            timer.cancel()

    def _end(self) -> str:
        """How the process ended, in words."""
        self.kill()
        try:
            code = self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            return "its process hangs in the driver"
        if code >= 0:
            return f"its process ended with exit code {code}"
        return f"its process was ended by {signal.Signals(-code).name}"

    def _with_words(self, why: str) -> str:
        """With the most telling line that it wrote, if any: ONNX Runtime says which library lacks only there."""
        with contextlib.suppress(OSError, ValueError):
            self._words.seek(0)
            said = self._words.read(_MOST_WORDS).decode("utf-8", "replace")
            if lacking := _LACKS.search(said):
                return f"it needs {lacking[1]}, which is not installed"
            told = _TOLD.search(said)
            if told and told[1] not in why:
                return f"{why}: {told[1].strip()[:300]}"
        return why


def _why(answer: Word) -> str:
    return answer.why if isinstance(answer, Failed) else f"it answered with {type(answer).__name__}"
