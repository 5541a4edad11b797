"""The networks of a training plan: the one of generated frames, and those fitted further to real ones, less a fold."""

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch

from cutouts import cut_out
from fit import Material, draw_material, fit
from folds import event_of
from frames import Background
from network import SmokeNet
from plumes import PlumeCanvas
from real import RealFrame
from start import started

GENERATED, VALIDATION, ALL = "generated", "validation", "all"
_RATE, _REAL_RATE = 4e-3, 2e-3
_START_EVERY, _START_FRAMES = 40, 12  # real frames that a model's batch norms are found on
_REAL_SHARE, _CUT_SHARE = 0.7, 0.5  # of the frames and of the plumes, once there are real ones
_PLUMES = 300


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is fitted, where, and from which seed; networks are kept in `folder` and read where they are there.

    `start` is the model to begin with instead of `steps` batches of generated frames.
    """

    folder: Path | None
    start: Path | None
    seed: int
    steps: int
    real_steps: int
    landscapes: int
    device: str
    batch: int
    workers: int


class Networks:
    """Each is fitted when it is first asked for."""

    def __init__(self, effort: Effort, frames: Sequence[RealFrame], fold_of: Sequence[int]) -> None:
        self._effort, self._frames, self._fold_of = effort, frames, fold_of
        self._began = time.monotonic()

    def names(self) -> list[str]:
        """All of them, what ships before what is only scored by cross-validation."""
        if not self._frames:
            return [GENERATED]
        folds = sorted(set(self._fold_of) - {0})
        return [GENERATED, VALIDATION, ALL, *map(_name, folds)] if len(folds) > 1 else [GENERATED, VALIDATION]

    def fold(self, fold: int) -> SmokeNet:
        """The one that saw neither this fold nor validation, which is fold 0."""
        return self.network(_name(fold))

    def network(self, name: str) -> SmokeNet:
        """One by its name."""
        if name == GENERATED:
            return self._generated
        kept = [index for index, fold in enumerate(self._fold_of) if self._sees(name, fold)]
        start = copy.deepcopy(self._generated)
        seed = self._effort.seed + 1 + self.names().index(name)
        return self._fitted(name, start, lambda: self._with(kept), seed, self._effort.real_steps, _REAL_RATE)

    @cached_property
    def _generated(self) -> SmokeNet:
        if self._effort.start is not None:
            few = self._frames[::_START_EVERY][:_START_FRAMES]
            return started(self._effort.start, [one.labelled.image for one in few])
        torch.manual_seed(self._effort.seed)
        start, seed = SmokeNet(), self._effort.seed
        return self._fitted(GENERATED, start, lambda: self._material, seed, self._effort.steps, _RATE)

    @cached_property
    def _material(self) -> Material:
        return draw_material(self._effort.seed, self._effort.landscapes, _PLUMES, self._effort.workers)

    @cached_property
    def _cut_outs(self) -> list[PlumeCanvas | None]:
        """For each frame the smoke that is cut from it."""
        return [None if one.background is None else cut_out(one.background) for one in self._frames]

    def _with(self, kept: Sequence[int]) -> Material:
        """The generated material, and the frames of those indices that may be fitted to."""
        by_event: dict[str, list[Background]] = {}
        for index in kept:
            one = self._frames[index]
            if one.background is not None:
                by_event.setdefault(event_of(one.stem), []).append(one.background)
        real = [by_event[event] for event in sorted(by_event)]
        cut = [smoke for index in kept if (smoke := self._cut_outs[index]) is not None]
        drawn = self._material
        return Material(drawn.landscapes, drawn.plumes, real, cut, _REAL_SHARE, _CUT_SHARE if cut else 0.0)

    def _fitted(
        self, name: str, start: SmokeNet, material: Callable[[], Material], seed: int, steps: int, rate: float
    ) -> SmokeNet:
        effort = self._effort
        path = None if effort.folder is None else effort.folder / f"{name}.pt"
        if path is not None and path.is_file():
            start.load_state_dict(torch.load(path, map_location=effort.device, weights_only=True))
            return start.to(effort.device).eval()
        told = _told(name, self._began)
        net = fit(start, material(), seed, steps, rate, effort.device, effort.batch, effort.workers, told)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            torch.save(net.state_dict(), path)
        return net

    @staticmethod
    def _sees(name: str, fold: int) -> bool:
        return name == ALL or (fold != 0 and name != _name(fold))


def _name(fold: int) -> str:
    return f"fold_{fold}" if fold else VALIDATION


def _told(name: str, began: float) -> Callable[[int, float], None]:
    """Prints the mean loss of every 100 steps."""
    losses: list[float] = []

    def on_step(step: int, loss: float) -> None:
        losses.append(loss)
        if (step + 1) % 100 == 0:
            minutes = (time.monotonic() - began) / 60.0
            print(f"{name}: step {step + 1}, loss {sum(losses[-100:]) / 100:.3f}, {minutes:.2f} min", flush=True)

    return on_step
