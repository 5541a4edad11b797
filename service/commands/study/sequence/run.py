"""`study sequence`: the paper's Table 2 for a recorded flight, each method's error against translation.

The paper's own rows are of recordings that are not ours to have.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from distloc.geometry.metrics import horizontal_error_m
from distloc.study.methods import MethodSpec, calibrated_spec, paper_methods
from distloc.study.runner import run_all
from distloc.study.table1.curves import mean_over_runs
from distloc.types import FloatArray
from service.commands.progress import count_progress, log_progress
from service.commands.study.files import cell, load_plots, prepared, rounded, write_csv, write_json
from service.commands.study.sequence.observed import ObservedSequence, observe_sequence
from service.common.files import write_whole
from service.config.load import load_config
from service.config.sections import Config
from service.recordings.flights import newest_flight
from service.recordings.recording import Recording

_LATE_SHARE = 0.75  # of the baseline: the mean is over the frames beyond it


def run_sequence_study(
    recording: Path, config: Path | None, out: Path, runs: int, jobs: int, seed: int, say: Callable[[str], None]
) -> None:
    """sequence.json, sequence.csv, curves.csv and error.png in `out`; RecordingError where the recording won't do."""
    load_plots()  # these two say what is missing before the work, not after it
    prepared(out)
    recording = newest_flight(recording, say)
    source = Recording(recording)
    path = config or source.config_path
    title = recording.resolve().name
    with log_progress(title) as on_stamp:
        observed = observe_sequence(source, load_config(path) if path else Config(), on_stamp)
    methods = (*paper_methods(), calibrated_spec())
    with count_progress(title, len(methods) * runs) as on_done:
        result = run_sequence(observed, methods, runs, seed, jobs, on_done)
    say(_text(result, observed))
    write_sequence(result, out, title)
    say(f"wrote {out}/sequence.json, sequence.csv, curves.csv and error.png")


class Row(msgspec.Struct, frozen=True):
    """One method's line of the table, in 3-D distance but for `horizontal_mean_m`; None where it gave no estimate.

    Of the mean over the runs: its minimum over the sequence, as the paper has it, and its means over the frames beyond
    3/4 of the baseline; `estimated_share` is over those frames too.
    """

    method: str
    min_m: float | None
    mean_m: float | None
    horizontal_mean_m: float | None
    runs: int
    estimated_share: float
    baseline_m: float
    mean_range_m: float


@dataclass(frozen=True, slots=True)
class ErrorCurve:
    """A method's errors (runs, T) to the truth nearest to its estimate; NaN where it gave none."""

    method: str
    error_m: FloatArray
    horizontal_error_m: FloatArray


@dataclass(frozen=True, slots=True)
class SequenceResult:
    """What `run_sequence` found; `translation_m` and `range_m` are (T,)."""

    translation_m: FloatArray
    range_m: FloatArray
    curves: tuple[ErrorCurve, ...]

    def summary(self) -> list[Row]:
        """The table's rows in the order of the methods."""
        return [self._row(curve) for curve in self.curves]

    def _row(self, curve: ErrorCurve) -> Row:
        baseline_m = float(self.translation_m.max())
        late = self.translation_m >= _LATE_SHARE * baseline_m
        mean_m, horizontal_m = mean_over_runs(curve.error_m), mean_over_runs(curve.horizontal_error_m)
        return Row(
            method=curve.method,
            min_m=_reduced(np.min, mean_m),
            mean_m=_reduced(np.mean, mean_m[late]),
            horizontal_mean_m=_reduced(np.mean, horizontal_m[late]),
            runs=curve.error_m.shape[0],
            estimated_share=round(float(np.isfinite(curve.error_m[:, late]).mean()), 4),
            baseline_m=round(baseline_m, 1),
            mean_range_m=round(float(self.range_m.mean()), 1),
        )


def run_sequence(
    observed: ObservedSequence,
    methods: Sequence[MethodSpec],
    runs: int,
    seed: int,
    jobs: int = 1,
    on_done: Callable[[int], None] = lambda done: None,
) -> SequenceResult:
    """Every method on the same frames, `runs` times each; the same seed gives the same result for any `jobs`."""
    if runs < 1 or not methods:
        raise ValueError(f"runs must be >= 1 and there must be a method, got {runs} and {len(methods)} methods")
    tasks = [_Task(observed, method, seed, run) for method in methods for run in range(runs)]
    errors_m = np.stack(run_all(_errors_m, tasks, jobs, on_done)).reshape(len(methods), runs, 2, -1)
    curves = (ErrorCurve(spec.name, own[:, 0], own[:, 1]) for spec, own in zip(methods, errors_m, strict=True))
    return SequenceResult(observed.translation_m, observed.range_m, tuple(curves))


@dataclass(frozen=True, slots=True)
class _Task:
    observed: ObservedSequence
    spec: MethodSpec
    seed: int
    run: int


def _errors_m(task: _Task) -> FloatArray:
    """Distance and distance on the map (2, T) of one method's estimates from the truth nearest to each."""
    observed = task.observed
    rng = np.random.Generator(np.random.SFC64(np.random.SeedSequence([task.seed, task.run])))
    method = task.spec.make(observed.camera, rng)
    errors_m = np.full((2, len(observed.poses)), np.nan)
    for index, (pose, mask) in enumerate(zip(observed.poses, observed.masks, strict=True)):
        position_enu_m = method.step(pose, mask.mask())
        if isinstance(position_enu_m, np.ndarray) and np.isfinite(position_enu_m).all():
            distances_m = np.linalg.norm(observed.truths_enu_m - position_enu_m, axis=1)
            nearest = int(np.argmin(distances_m))
            errors_m[:, index] = (
                distances_m[nearest],
                horizontal_error_m(position_enu_m, observed.truths_enu_m[nearest]),
            )
    return errors_m


def write_sequence(result: SequenceResult, out: Path, title: str = "") -> None:
    """Write sequence.json, sequence.csv, curves.csv and error.png into a folder.

    Raises MissingExtraError, before anything is written, where matplotlib is missing.
    """
    plots = load_plots()
    errors_m = {curve.method: mean_over_runs(curve.error_m) for curve in result.curves}
    rows = result.summary()
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "sequence.json", rows)
    write_csv(out / "sequence.csv", [msgspec.structs.asdict(row) for row in rows])
    write_csv(out / "curves.csv", [point for curve in result.curves for point in _points(result.translation_m, curve)])
    figure = plots.error_figure(result.translation_m, errors_m, title)
    write_whole(out / "error.png", plots.png_from_figure(figure))


def _points(translation_m: FloatArray, curve: ErrorCurve) -> list[dict[str, str | float | None]]:
    columns = {
        "translation_m": translation_m,
        "error_m": mean_over_runs(curve.error_m),
        "horizontal_error_m": mean_over_runs(curve.horizontal_error_m),
    }
    return [
        {"method": curve.method} | {name: rounded(values_m[frame], 2) for name, values_m in columns.items()}
        for frame in range(translation_m.size)
    ]


def _reduced(reduce: Callable[[FloatArray], np.float64], values_m: FloatArray) -> float | None:
    held_m = values_m[np.isfinite(values_m)]
    return rounded(reduce(held_m), 2) if held_m.size else None


def _text(result: SequenceResult, observed: ObservedSequence) -> str:
    rows = result.summary()
    lines = [f"{'method':8}{'min m':>9}{'mean m':>9}{'on the map':>12}{'no est.':>9}{'runs':>6}"]
    for row in rows:
        lines.append(
            f"{row.method:8}{cell(row.min_m, 9, 1)}{cell(row.mean_m, 9, 1)}{cell(row.horizontal_mean_m, 12, 1)}"
            f"{1 - row.estimated_share:>9.1%}{row.runs:>6}"
        )
    refused = ", ".join(f"{count} {reason}" for reason, count in observed.refused.items()) or "none"
    return "\n".join(
        [
            *lines,
            "",
            f"{len(observed.poses)} frames at least {observed.step_m:g} m apart, baseline {rows[0].baseline_m:.0f} m, "
            f"mean range {rows[0].mean_range_m:.0f} m; refused: {refused}",
            "means beyond three quarters of the baseline; no est.: frames there without an estimate",
        ]
    )
