"""Train the model that ships, from a seed: `python models/training/train.py --help` (see README.md here).

First on generated frames alone; then, where folders of real frames are given, with those among them. What the card says
of real frames is then cross-validated: every frame is scored by a network that saw nothing of its event or clip.
"""

import argparse
import hashlib
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from card import MARGIN, Scored, Scores, write_card, write_cross_validation
from distloc.study.segmentation import ImageScore, summarised
from export import INPUT_H, INPUT_W, THRESHOLDS, export_onnx, service_scores
from fit import BATCH
from folds import event_of, folds, kin
from network import SmokeNet
from networks import ALL, GENERATED, VALIDATION, Effort, Networks
from real import RealFrame, real_frames

VERSION = "2.1"


@dataclass(frozen=True, slots=True)
class Plan:
    """What is asked for on the command line."""

    out: Path
    networks: Path | None
    start: Path | None
    start_saw: tuple[str, ...]
    real: tuple[Path, ...]
    measure: tuple[Path, ...]
    validation: tuple[str, ...]
    seed: int
    steps: int
    real_steps: int
    folds: int
    landscapes: int
    device: str
    batch: int
    threads: int
    workers: int
    fit_only: bool
    cross_validate: Path | None


def train(plan: Plan) -> None:
    """The model at `plan.out` and its card beside it."""
    torch.set_num_threads(plan.threads)
    cv2.setNumThreads(1)  # the processes that draw are forked, and a fork of its threads hangs
    torch.use_deterministic_algorithms(plan.device == "cpu")
    began = time.monotonic()
    frames = [*real_frames(plan.real, True), *real_frames(plan.measure, False)]
    has_smoke = [one.labelled.truth is not None for one in frames]
    fold_of = folds([one.stem for one in frames], has_smoke, plan.validation, plan.folds)
    effort = Effort(
        plan.networks,
        plan.start,
        plan.seed,
        plan.steps,
        plan.real_steps,
        plan.landscapes,
        plan.device,
        plan.batch,
        plan.workers,
    )
    networks = Networks(effort, frames, fold_of)
    if plan.fit_only:
        for name in networks.names():
            networks.network(name)
        return
    is_known = kin([one.stem for one in frames], [one.stem for one in frames if one.folder in plan.start_saw])
    if plan.cross_validate is not None:
        scores = _held_out(networks, frames, fold_of, is_known, sorted(set(fold_of) - {0}), plan)
        write_cross_validation(plan.cross_validate, _command(plan), scores)
        print(f"wrote {plan.cross_validate}")
        return
    scored = [fold for fold in sorted(set(fold_of)) if fold == 0 or plan.folds]
    scores = _held_out(networks, frames, fold_of, is_known, scored, plan)
    threshold = scores.threshold(MARGIN) if frames else THRESHOLDS[0]
    ships = (ALL if plan.folds else VALIDATION) if frames else GENERATED
    export_onnx(networks.network(ships), plan.out, VERSION, threshold)
    digest = hashlib.sha256(plan.out.read_bytes()).hexdigest()
    minutes = (time.monotonic() - began) / 60.0
    size = f"{INPUT_W} x {INPUT_H}"
    write_card(plan.out.with_suffix(".md"), plan.out, VERSION, digest, threshold, size, _command(plan), scores)
    print(f"wrote {plan.out} and {plan.out.with_suffix('.md')} after {minutes:.0f} minutes")


def _command(plan: Plan) -> str:
    """What of the command line decides the networks, less the folders."""
    begun = f"--steps {plan.steps}"
    if plan.start is not None:
        begun = f"--start {plan.start} --start-saw {' '.join(plan.start_saw)}"
    command = (
        f"--seed {plan.seed} {begun} --real-steps {plan.real_steps} --batch {plan.batch} "
        f"--folds {plan.folds} --landscapes {plan.landscapes}"
    )
    return command + (f" --validation {' '.join(plan.validation)}" if plan.validation else "")


def _held_out(
    networks: Networks,
    frames: Sequence[RealFrame],
    fold_of: Sequence[int],
    is_known: Sequence[bool],
    folds: Sequence[int],
    plan: Plan,
) -> Scores:
    """The scores of the frames of those folds, each by a network that saw neither its fold nor validation."""
    scored: list[Scored] = []
    scores: dict[float, list[ImageScore]] = {threshold: [] for threshold in THRESHOLDS}
    with tempfile.TemporaryDirectory() as folder:
        for fold in folds:
            chosen = [index for index, one in enumerate(fold_of) if one == fold]
            held = [frames[index] for index in chosen]
            scored += [
                Scored(frames[i].folder, event_of(frames[i].stem), fold, frames[i].background is not None, is_known[i])
                for i in chosen
            ]
            for threshold, found in _scored(networks.fold(fold), held, Path(folder) / f"fold_{fold}.onnx").items():
                scores[threshold] += found
    fitted = sorted({one.folder for one in frames if one.background is not None})
    return Scores(fitted, scored, scores, plan.validation, plan.start_saw)


def _scored(net: SmokeNet, frames: Sequence[RealFrame], path: Path) -> dict[float, list[ImageScore]]:
    export_onnx(net, path, VERSION)
    scores = service_scores(path, frames)
    for threshold, found in scores.items():
        one = summarised(found, [0.0])
        print(
            f"  {path.stem} at {threshold}: found {one.found_share:.2f} of {one.smoke_images}, false "
            f"{one.false_per_smoke_image:.2f} beside, {one.false_per_negative:.2f} on each of {one.negative_images} "
            f"without, centre off by {one.centroid_error_px_median:.1f} px",
            flush=True,
        )
    return scores


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("models/smoke-seg.onnx"), help="the card goes beside it")
    parser.add_argument(
        "--networks", type=Path, metavar="DIR", help="keep each fitted network there; read those that are there"
    )
    parser.add_argument(
        "--start", type=Path, metavar="FILE", help="a model of this network, to be fitted further: no --steps then"
    )
    parser.add_argument(
        "--start-saw", nargs="*", default=(), metavar="NAME", help="names of the folders that it was fitted to before"
    )
    parser.add_argument("--real", type=Path, nargs="*", default=(), metavar="DIR", help="folders of real frames")
    parser.add_argument("--measure", type=Path, nargs="*", default=(), metavar="DIR", help="scored, never fitted to")
    parser.add_argument(
        "--validation", nargs="*", default=(), metavar="DAY", help="fires that the threshold is chosen on"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=1600, help="batches of generated frames")
    parser.add_argument("--real-steps", type=int, default=650, help="batches with real frames, for each network")
    parser.add_argument("--folds", type=int, default=4, help="without any the network of --validation ships")
    parser.add_argument("--landscapes", type=int, default=600)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--batch", type=int, default=BATCH, help="frames; 64 suit a GPU")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="processes that draw frames: 16 feed a GPU")
    parser.add_argument("--fit-only", action="store_true", help="score nothing: --networks DIR alone is written")
    parser.add_argument(
        "--cross-validate",
        type=Path,
        metavar="FILE",
        help="fit and score the folds' networks alone: only FILE is written",
    )
    asked = vars(parser.parse_args())
    train(Plan(**{key: tuple(value) if isinstance(value, list) else value for key, value in asked.items()}))


if __name__ == "__main__":
    main()
