"""The process that has the GPU: opens the model there, runs it once, says what came of it, then runs what it is given.

`accelerator.process` starts it, with the handle of one connection. It ends with that connection or with its parent.
"""

import contextlib
import hashlib
import mmap
import os
import signal
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import onnxruntime

from service.config.sections import ConfigError
from service.segmenters.accelerator.assignment import parts_of_profile
from service.segmenters.accelerator.board import board_name, driver, tensorrt_version
from service.segmenters.accelerator.engine_cache import EngineCache
from service.segmenters.accelerator.protocol import Failed, Gave, Given, Plan, Ready, input_in, receive, send
from service.segmenters.model_session import CPU, TENSORRT, ModelError, ModelSession, Tuning

_FIRST_TO_GO = "800"  # of 1000, where memory runs out: the service goes on without it
_OPENING = "not a model that can be run: "  # on this provider, that is
_ON = "True"  # ONNX Runtime refuses "1" for TensorRT's switches


def main(handle: int, shared: int) -> None:
    """Serve one connection to its end; inputs lie in the memory that is shared."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # who stops the service stops it last: the parent ends it
    _end_with_parent()
    connection, memory = Connection(handle), mmap.mmap(shared, 0)
    with contextlib.suppress(EOFError, OSError):
        plan = receive(connection)
        if not isinstance(plan, Plan):
            return
        try:
            session, ready = _opened(plan)
        except (ConfigError, ModelError, OSError) as error:
            send(connection, Failed(str(error).rpartition(_OPENING)[2]))
            return
        send(connection, ready)
        _mute()  # it may fly for hours, and what it writes is kept in a file until then
        while True:
            _answer(connection, memory, session, plan)


def tuning_of(plan: Plan, engines: Path | None, profile: str) -> Tuning:
    """Fixed sides and, for TensorRT, the inputs' shapes, so that no engine is built twice; where engines are kept."""
    low, high = np.min(plan.shapes, axis=0), np.max(plan.shapes, axis=0)
    options = {"trt_fp16_enable": _ON if plan.fp16 else "False"}
    for key, shape in (("min", low), ("max", high), ("opt", high)):
        options[f"trt_profile_{key}_shapes"] = f"{plan.input_name}:{'x'.join(map(str, shape))}"
    if engines is not None:
        options |= {"trt_engine_cache_enable": _ON, "trt_engine_cache_path": str(engines)}
    return Tuning({TENSORRT: options} if TENSORRT in plan.providers else {}, plan.sides, profile)


def engine_parts(plan: Plan) -> dict[str, str]:
    """What an engine is built for: with any of it another, it is another engine."""
    try:
        model = hashlib.sha256(Path(plan.model).read_bytes()).hexdigest()[:16]
    except OSError:
        model = "unreadable"
    shapes = ", ".join("x".join(map(str, shape)) for shape in plan.shapes)
    return {
        "model": model,
        "board": board_name(),
        "driver": driver(),
        "onnxruntime": str(onnxruntime.__version__),
        "tensorrt": tensorrt_version(),
        "precision": "fp16" if plan.fp16 else "fp32",
        "inputs": shapes,
    }


def _opened(plan: Plan) -> tuple[ModelSession, Ready]:
    start_s = time.monotonic()
    keeps = bool(plan.engines) and TENSORRT in plan.providers
    cache = EngineCache(Path(plan.engines), engine_parts(plan)) if keeps else None
    with tempfile.TemporaryDirectory(prefix="distloc-") as scratch:
        tuning = tuning_of(plan, cache.folder if cache else None, f"{scratch}/profile")
        session = ModelSession(Path(plan.model), plan.providers, plan.sha256, tuning, is_told=False)
        if session.provider == CPU:
            raise ModelError(f"ONNX Runtime could not load {plan.providers[0]}")
        for shape in plan.shapes:
            session.outputs_of(np.zeros(shape, np.float32), plan.outputs)
        parts = parts_of_profile(session.end_profile())
    took_s = time.monotonic() - start_s
    run_s = time.monotonic()
    session.outputs_of(np.zeros(plan.shapes[0], np.float32), plan.outputs)
    run_ms = (time.monotonic() - run_s) * 1e3
    notes: tuple[str, ...] = ()
    if cache:
        cache.seal()
        cache.close()
        notes = tuple(cache.notes)
    return session, Ready(session.provider, parts, notes, took_s, run_ms)


def _answer(connection: Connection, memory: mmap.mmap, session: ModelSession, plan: Plan) -> None:
    given = receive(connection)
    if not isinstance(given, Given):
        raise OSError(f"an input is awaited, got {type(given).__name__}")
    try:
        outputs = session.outputs_of(input_in(memory, given.shape), plan.outputs)
    except ModelError as error:
        send(connection, Failed(str(error)))
        return
    send(connection, Gave(tuple(one.shape for one in outputs)), outputs)


def _end_with_parent() -> None:
    """Its standard input ends with whoever started it, however that one ends; memory that runs out takes it first."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(_FIRST_TO_GO, encoding="ascii")
    threading.Thread(target=_wait_for_the_end, name="parent", daemon=True).start()


def _wait_for_the_end() -> None:
    os.read(sys.stdin.fileno(), 1)
    os.kill(os.getpid(), signal.SIGKILL)


def _mute() -> None:
    nothing = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout.fileno(), sys.stderr.fileno()):
        os.dup2(nothing, stream)
    os.close(nothing)
