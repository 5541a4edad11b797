"""Train the model that ships, from a seed: `python models/training/train.py --help` (see README.md here).

First on generated frames alone; then, where folders of real frames are given, with those among them. What the card says
of real frames is then cross-validated: every frame is scored by a network that saw nothing of its event or clip.
"""

import argparse
import copy
import hashlib
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from card import Scores, write_card
from distloc.study.segmentation import ImageScore, Summary, summarised
from export import THRESHOLDS, export_onnx, service_scores
from fit import BATCH, Material, draw_material, fit
from network import SmokeNet
from real import RealFrame, folds, real_frames

VERSION = "1.1"
_RATE, _REAL_RATE = 4e-3, 2e-3
_REAL_SHARE = 0.5  # of the frames, once there are real ones


@dataclass(frozen=True, slots=True)
class Plan:
    """What is asked for on the command line."""

    out: Path
    generated: Path | None
    real: tuple[Path, ...]
    seed: int
    steps: int
    real_steps: int
    folds: int
    landscapes: int
    device: str
    threads: int


def train(plan: Plan) -> None:
    """The model at `plan.out` and its card beside it."""
    torch.set_num_threads(plan.threads)
    torch.use_deterministic_algorithms(plan.device == "cpu")
    began = time.monotonic()
    material = draw_material(plan.seed, plan.landscapes, 300, plan.threads)
    generated = _generated(plan, material, began)
    frames = real_frames(plan.real) if plan.real else []
    with tempfile.TemporaryDirectory() as folder:
        alone = _scored(generated, frames, Path(folder) / "alone.onnx")
        held_out = _cross_validated(plan, generated, material, frames, Path(folder), began)
    final = generated
    if frames:
        final = _with_real(plan, generated, material, frames, plan.seed + 1, "all", began)
    scores = Scores([one.labelled.path.parent.parent.name for one in frames], alone, held_out)
    threshold = scores.threshold() if frames else THRESHOLDS[0]
    export_onnx(final, plan.out, VERSION, threshold)
    digest = hashlib.sha256(plan.out.read_bytes()).hexdigest()
    minutes = (time.monotonic() - began) / 60.0
    command = (
        f"--seed {plan.seed} --steps {plan.steps} --real-steps {plan.real_steps} --folds {plan.folds} "
        f"--landscapes {plan.landscapes} --threads {plan.threads}"
    )
    write_card(plan.out.with_suffix(".md"), plan.out, VERSION, digest, threshold, command, minutes, scores)
    print(f"wrote {plan.out} and {plan.out.with_suffix('.md')} after {minutes:.0f} minutes")


def _generated(plan: Plan, material: Material, began: float) -> SmokeNet:
    """The network of generated frames alone, read where it was kept."""
    torch.manual_seed(plan.seed)
    net = SmokeNet()
    if plan.generated is not None and plan.generated.is_file():
        net.load_state_dict(torch.load(plan.generated, map_location=plan.device, weights_only=True))
        return net.to(plan.device).eval()
    net = fit(net, material, plan.seed, plan.steps, _RATE, plan.device, on_step=_told("generated", began))
    if plan.generated is not None:
        torch.save(net.state_dict(), plan.generated)
    return net


def _cross_validated(
    plan: Plan, generated: SmokeNet, material: Material, frames: Sequence[RealFrame], folder: Path, began: float
) -> dict[float, list[ImageScore]]:
    """By the threshold each frame's score by a network that was not fitted to its event or clip."""
    scores: dict[float, dict[int, ImageScore]] = {threshold: {} for threshold in THRESHOLDS}
    for number, held in enumerate(folds(frames, plan.folds) if frames else []):
        others = [frame for index, frame in enumerate(frames) if index not in set(held)]
        name = f"fold {number + 1} of {plan.folds}"
        net = _with_real(plan, generated, material, others, plan.seed + 10 + number, name, began)
        found = _scored(net, [frames[index] for index in held], folder / f"fold_{number}.onnx")
        for threshold, of_held in found.items():
            scores[threshold].update(zip(held, of_held, strict=True))
    return {threshold: [by_index[index] for index in range(len(frames))] for threshold, by_index in scores.items()}


def _with_real(
    plan: Plan, start: SmokeNet, material: Material, frames: Sequence[RealFrame], seed: int, name: str, began: float
) -> SmokeNet:
    real = [frame.background for frame in frames]
    mixed = Material(material.landscapes, material.plumes, real, _REAL_SHARE)
    net = copy.deepcopy(start)
    return fit(net, mixed, seed, plan.real_steps, _REAL_RATE, plan.device, on_step=_told(name, began))


def _scored(net: SmokeNet, frames: Sequence[RealFrame], path: Path) -> dict[float, list[ImageScore]]:
    if not frames:
        return {threshold: [] for threshold in THRESHOLDS}
    export_onnx(net, path, VERSION)
    scores = {threshold: service_scores(path, frames, threshold) for threshold in THRESHOLDS}
    for threshold, found in scores.items():
        print(_line(threshold, summarised(found, [0.0])), flush=True)
    return scores


def _line(threshold: float, one: Summary) -> str:
    return (
        f"  real frames at {threshold}: found {one.found_share:.2f} of {one.smoke_images}, "
        f"false {one.false_per_negative:.2f} on each of {one.negative_images} without smoke, "
        f"centre off by {one.centroid_error_px_median:.1f} px"
    )


def _told(name: str, began: float) -> Callable[[int, float], None]:
    """Prints the mean loss of every 50 steps."""
    losses: list[float] = []

    def on_step(step: int, loss: float) -> None:
        losses.append(loss)
        if (step + 1) % 50 == 0:
            minutes = (time.monotonic() - began) / 60.0
            print(f"{name}: step {step + 1}, loss {sum(losses[-50:]) / 50:.3f}, {minutes:.1f} min", flush=True)

    return on_step


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("models/smoke-seg.onnx"), help="the card goes beside it")
    parser.add_argument(
        "--generated",
        type=Path,
        metavar="FILE",
        help="keep the network of generated frames alone; read it if it is there",
    )
    parser.add_argument("--real", type=Path, nargs="*", default=(), metavar="DIR", help="folders of real frames")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=2500, help=f"batches of {BATCH} generated frames")
    parser.add_argument("--real-steps", type=int, default=400, help="batches with real frames, for each network")
    parser.add_argument("--folds", type=int, default=4)
    parser.add_argument("--landscapes", type=int, default=600)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--threads", type=int, default=2)
    train(Plan(**vars(parser.parse_args())))


if __name__ == "__main__":
    main()
