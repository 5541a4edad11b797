"""The model's card: what it is, what it was trained on, how well it does, where it fails."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.study.segmentation import ImageScore, Summary, summarised

MOST_FALSE = 0.3  # segments in a frame without smoke
_HEAD = """# {name}

Smoke of wildfires in the frames of a drone or a mast by day, from colour alone. Version {version}, {kilobytes} KB.

sha256 `{digest}`

- **Takes** RGB, 0 to 255 times 1/255, N C H W; height and width are multiples of 32, about 640 x 360 pixels in all,
  in the frame's own proportions (`distloc.resize` = `budget`).
- **Gives** logits of smoke at half that size; threshold {threshold}.
- **Made** by `python models/training/train.py {command}`{real}, in {minutes:.0f} minutes,
  cross-validation included.
- **Licence** Apache-2.0, as the project; the generated frames are the project's own.
"""
_LIMITS = Path(__file__).with_name("limits.md")
_REAL = """
## Real frames among the training data

{credits}

## Scores on real frames

A frame is found where a segment's centroid lies in the smoke's mask or box, or within 10 px of it at 512 px of width.
Every frame is scored by a network that saw nothing of its event (place and time) or clip; the one that ships saw all.

```
{table}
```

`generated` is the network before it saw a real frame. The frames are few: a share found of 19 has a standard error of
0.11. The threshold was chosen on these very scores: the least of those below with at most {most_false} false segments
in a frame without smoke. By the threshold, cross-validated:

```
{sweep}
```
"""
_CREDITS = {
    "smoke_hpwren_smokeseg": "smoke_hpwren_smokeseg: frames by HPWREN (https://www.hpwren.ucsd.edu/), masks of "
    "SmokeSeg by the authors of FoSp (MIT, github LujianYao/FoSp)",
    "smoke_hpwren_drawn": "smoke_hpwren_drawn: frames by HPWREN (https://www.hpwren.ucsd.edu/), outlined by the "
    "project (training/smoke_hpwren.outlines.txt)",
    "smoke_boreal_uav": "smoke_boreal_uav: Boreal Forest Fire dataset (CC BY 4.0, doi 10.23729/fd-72c6cf74-b8eb-3687-"
    "860d-bf93a1ab94c9); its boxes were made masks by their brightness",
    "negatives_horizon_uav": "negatives_horizon_uav: horizon-detection-for-uav (MIT, github NovelioPI)",
}


@dataclass(frozen=True, slots=True)
class Scores:
    """Each real frame's folder; by threshold its score by the network of generated data and by one that held it out."""

    folders: Sequence[str]
    alone: Mapping[float, Sequence[ImageScore]]
    held_out: Mapping[float, Sequence[ImageScore]]

    def threshold(self) -> float:
        """The least at which the networks that held frames out see at most `MOST_FALSE` in a frame without smoke."""
        few = [one for one, found in self.held_out.items() if summarised(found, [0.0]).false_per_negative <= MOST_FALSE]
        return min(few, default=max(self.held_out))


def write_card(
    path: Path, model: Path, version: str, digest: str, threshold: float, command: str, minutes: float, scores: Scores
) -> None:
    """Markdown at `path`; without real frames there is nothing to say of them."""
    names = sorted(set(scores.folders))
    text = _HEAD.format(
        name=model.name,
        version=version,
        kilobytes=model.stat().st_size // 1024,
        digest=digest,
        threshold=threshold,
        command=command,
        real=" --real " + " ".join(names) if names else "",
        minutes=minutes,
    )
    if names:
        credits = "\n".join(f"- {_CREDITS.get(name, name)}" for name in names)
        text += _REAL.format(
            credits=credits, table=_table(names, scores, threshold), sweep=_sweep(names, scores), most_false=MOST_FALSE
        )
    path.write_text(text + _LIMITS.read_text())


def _table(names: Sequence[str], scores: Scores, threshold: float) -> str:
    lines = [f"{'':<24}{'':>6}{'generated':>26}{'cross-validated':>30}"]
    lines.append(f"{'folder':<24}{'frames':>6}" + 2 * f"{'found':>9}{'false':>8}{'IoU':>7}{'px':>6}")
    both = scores.alone[threshold], scores.held_out[threshold]
    for name in [*names, "all"]:
        kept = [index for index, folder in enumerate(scores.folders) if name in (folder, "all")]
        cells = "".join(_cells([found[index] for index in kept]) for found in both)
        lines.append(f"{name:<24}{len(kept):>6}{cells}")
    lines.append("false: segments on each frame without smoke; px: the centroid's median error, of what was found")
    return "\n".join(lines)


def _sweep(names: Sequence[str], scores: Scores) -> str:
    lines = [f"{'threshold':<10}" + "".join(f"{name:>24}" for name in names) + f"{'false':>8}{'px':>6}"]
    for threshold, found in scores.held_out.items():
        by_folder = [[one for one, of in zip(found, scores.folders, strict=True) if of == name] for name in names]
        line = f"{threshold:<10}" + "".join(f"{_found(summarised(one, [0.0])):>24}" for one in by_folder)
        whole = summarised(found, [0.0])
        lines.append(line + f"{_number(whole.false_per_negative, 2):>8}{_number(whole.centroid_error_px_median, 1):>6}")
    return "\n".join(lines)


def _cells(scores: Sequence[ImageScore]) -> str:
    one = summarised(scores, [0.0])
    numbers = f"{_number(one.false_per_negative, 2):>8}{_number(one.iou_mean, 2):>7}"
    return f"{_found(one):>9}{numbers}{_number(one.centroid_error_px_median, 1):>6}"


def _found(one: Summary) -> str:
    return f"{round(one.found_share * one.smoke_images)} of {one.smoke_images}" if one.smoke_images else "-"


def _number(value: float, digits: int) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"
