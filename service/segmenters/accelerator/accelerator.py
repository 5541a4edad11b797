"""Goes over from the CPU to a GPU once that is ready and has proved itself, and back at once where it fails.

The segmenter says what is to run and asks it first; the flight starts and closes it. A thread of its own waits for the
process that has the GPU, so that neither the event loop nor a frame ever does.
"""

import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from service.common.shown import shown
from service.segmenters.accelerator.assignment import parts_text, short
from service.segmenters.accelerator.process import AcceleratorError, GpuProcess
from service.segmenters.accelerator.protocol import Part, Plan, Ready

RETRIES_S = (60.0, 300.0, 1500.0)  # one that has worked and fails is opened again after these, then no more
_log = logging.getLogger(__name__)
_nowhere = logging.getLogger(f"{__name__}.nowhere")
_nowhere.disabled = True  # of who says it otherwise

State = Literal["none", "preparing", "proving", "used", "failed"]
Values = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class AcceleratorState:
    """What the status says: `provider` is the one that is used, or tried; `parts` what each provider got of the model.

    none: there is none to go over to; preparing: an engine may be under construction; proving: it is compared with the
    CPU on the next frame; failed: the CPU does it all. `refused` says by a provider's name why it is not used,
    `notes` what was wrong with the engines kept.
    """

    state: State = "none"
    provider: str = ""
    refused: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    parts: tuple[Part, ...] = ()
    took_s: float = 0.0
    run_ms: float = 0.0


class Worker(Protocol):
    """The process that has the GPU, as GpuProcess is."""

    def wait_ready(self) -> Ready:
        """What it opened; AcceleratorError where it cannot."""
        ...

    def run(self, values: Values) -> list[Values]:
        """The outputs for one input; AcceleratorError where it fails."""
        ...

    def kill(self) -> None:
        """End it, from any thread."""
        ...

    def close(self) -> None:
        """End it and let go of it."""
        ...


class Accelerating(Protocol):
    """What a segmenter asks before its own session."""

    @property
    def state(self) -> AcceleratorState:
        """As it is now."""
        ...

    def plan(self, plan: Plan) -> None:
        """What will be run; before `start`."""
        ...

    def start(self) -> None:
        """Begin to prepare it; returns at once."""
        ...

    def close(self) -> None:
        """End it."""
        ...

    def settle(self) -> None:
        """Wait until it is ready to be proved, or has failed: for commands, which have the time."""
        ...

    def run(self, values: Values, is_proof: bool = False) -> list[Values] | None:
        """The outputs for an input; None: it is not (or no longer) to be had, ask the CPU.

        One that is not proved runs for a proof alone.
        """
        ...

    def judge(self, fault: str) -> None:
        """After a frame on both: an empty `fault` says that it saw what the CPU saw."""
        ...


class NoAccelerator:
    """There is none: nothing else was asked for, or ONNX Runtime has nothing else."""

    state = AcceleratorState()

    def plan(self, plan: Plan) -> None:
        """Nothing."""

    def start(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

    def settle(self) -> None:
        """Nothing."""

    def run(self, values: Values, is_proof: bool = False) -> list[Values] | None:
        """None."""
        return None

    def judge(self, fault: str) -> None:
        """Nothing."""


class Accelerator:
    """Tries the plan's providers in their order, each with those after it for what it cannot run itself.

    `run` and `judge` are called from one thread, the segmenter's.
    """

    def __init__(
        self,
        open_worker: Callable[[Plan], Worker] = GpuProcess,
        retries_s: Sequence[float] = RETRIES_S,
        is_told: bool = True,
    ) -> None:
        self.state = AcceleratorState(state="preparing")
        self._open_worker, self._retries_s = open_worker, retries_s
        self._log = _log if is_told else _nowhere
        self._plan: Plan | None = None
        self._worker: Worker | None = None
        self._closed, self._lost, self._settled = threading.Event(), threading.Event(), threading.Event()
        self._was_used = False
        self._thread = threading.Thread(target=self._supervise, name="accelerator", daemon=True)

    def plan(self, plan: Plan) -> None:
        """What will be run; before `start`."""
        self._plan = plan
        self.state = replace(self.state, provider=plan.providers[0])

    def start(self) -> None:
        """Begin to prepare it; returns at once."""
        if self._plan is not None:
            self._log.info("the segmenter begins on the CPU, while %s is prepared", short(self._plan.providers[0]))
            self._thread.start()

    def close(self) -> None:
        """End it, also while it is being prepared."""
        self._closed.set()
        self._lost.set()
        if (worker := self._worker) is not None:
            worker.kill()
        if self._thread.is_alive():
            self._thread.join()

    def settle(self) -> None:
        """Wait until it is ready to be proved, or has failed."""
        self._settled.wait()

    def run(self, values: Values, is_proof: bool = False) -> list[Values] | None:
        """The outputs for an input of the plan's shapes; None: it is not to be had, or no longer."""
        worker, plan, state = self._worker, self._plan, self.state.state
        if not (state == "used" or (is_proof and state == "proving")) or worker is None or plan is None:
            return None
        if values.shape not in plan.shapes:
            return None
        try:
            return worker.run(values)
        except AcceleratorError as error:
            self._lose(str(error))
            return None

    def judge(self, fault: str) -> None:
        """Go over to it if it saw what the CPU saw, and back if it does no more."""
        if fault and self.state.state in ("proving", "used"):
            self._lose(fault)
        if self.state.state != "proving":
            return
        state = self.state = replace(self.state, state="used")
        self._log.info(
            "the segmenter runs on %s from now on, %.1f ms a run, ready after %.0f s: %s",
            short(state.provider),
            state.run_ms,
            state.took_s,
            parts_text(state.parts) or "which parts of the model it runs is not known",
        )

    def _lose(self, why: str) -> None:
        """It failed on a frame, which the CPU does."""
        self._was_used = self.state.state == "used"
        self._refuse(self.state.provider, why)
        self._settled.clear()
        self._lost.set()

    def _refuse(self, provider: str, why: str) -> None:
        if self._closed.is_set():
            return
        how = "failed" if self.state.state == "used" else "is not used"
        self.state = replace(
            self.state, state="failed", provider=provider, refused={**self.state.refused, short(provider): why}
        )
        self._log.warning("%s %s: %s; the segmenter runs on the CPU", short(provider), how, shown(why))

    def _supervise(self) -> None:
        try:
            self._try_each()
        finally:
            self._settled.set()

    def _try_each(self) -> None:
        assert self._plan is not None
        wanted = self._plan.providers
        for place in range(len(wanted) - 1):  # the last is the CPU
            plan = msgspec.structs.replace(self._plan, providers=wanted[place:])
            for pause_s in (0.0, *self._retries_s):
                if pause_s:
                    self._settled.set()
                if self._closed.wait(pause_s):
                    return
                if not self._serve(plan):
                    break

    def _serve(self, plan: Plan) -> bool:
        """Open it and wait for its end; whether it has worked, so that it is worth another try."""
        self._lost.clear()
        self._settled.clear()
        self._was_used = False
        self.state = replace(self.state, state="preparing", provider=plan.providers[0])
        try:
            self._worker = worker = self._open_worker(plan)
        except OSError as error:  # no process, no descriptor left
            self._refuse(plan.providers[0], f"its process cannot be started: {error}")
            return False
        try:
            if self._closed.is_set():
                return False
            self._opened(worker.wait_ready(), plan)
            self._lost.wait()
        except AcceleratorError as error:
            self._refuse(plan.providers[0], str(error))
        finally:
            self._worker = None
            worker.close()
        return self._was_used

    def _opened(self, ready: Ready, plan: Plan) -> None:
        for note in ready.notes:
            self._log.warning("%s", shown(note))
        if ready.provider != plan.providers[0]:
            self._refuse(plan.providers[0], f"ONNX Runtime could not load it and took {short(ready.provider)}")
        took_s, run_ms = round(ready.took_s, 1), round(ready.run_ms, 1)
        self.state = AcceleratorState(
            "proving", ready.provider, self.state.refused, ready.notes, ready.parts, took_s, run_ms
        )
        self._settled.set()
