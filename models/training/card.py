"""The model's card: what it is, what it was trained on, how well it does, where it fails."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.study.segmentation import ImageScore, summarised

_HEAD = """# {name}

Smoke of wildfires in the frames of a drone or a mast by day, from colour alone. Version {version}, {kilobytes} KB.

sha256 `{digest}`

- **Takes** RGB, 0 to 255 times 1/255, N C H W; height and width are multiples of 32, about 640 x 360 pixels in all,
  in the frame's own proportions (`distloc.resize` = `budget`).
- **Gives** logits of smoke at half that size; threshold {threshold}.
- **Made** by `python models/training/train.py {command}`{real}, in {minutes:.0f} minutes.
- **Licence** Apache-2.0, as the project; the generated frames are the project's own.
"""
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
0.11.
"""
_CREDITS = {
    "smoke_hpwren_smokeseg": "smoke_hpwren_smokeseg: frames by HPWREN (https://www.hpwren.ucsd.edu/), masks of "
    "SmokeSeg by the authors of FoSp (MIT, github LujianYao/FoSp)",
    "smoke_boreal_uav": "smoke_boreal_uav: Boreal Forest Fire dataset (CC BY 4.0, doi 10.23729/fd-72c6cf74-b8eb-3687-"
    "860d-bf93a1ab94c9); its boxes were made masks by their brightness",
    "negatives_horizon_uav": "negatives_horizon_uav: horizon-detection-for-uav (MIT, github NovelioPI)",
}


@dataclass(frozen=True, slots=True)
class Scores:
    """Each real frame's folder, and its score by the network of generated data alone and by one that held it out."""

    folders: Sequence[str]
    alone: Sequence[ImageScore]
    held_out: Sequence[ImageScore]


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
        text += _REAL.format(credits=credits, table=_table(names, scores))
    limits = path.with_suffix(".limits.md")
    path.write_text(text + (limits.read_text() if limits.is_file() else ""))


def _table(names: Sequence[str], scores: Scores) -> str:
    lines = [f"{'':<24}{'':>6}{'generated':>26}{'cross-validated':>30}"]
    lines.append(f"{'folder':<24}{'frames':>6}" + 2 * f"{'found':>9}{'false':>8}{'IoU':>7}{'px':>6}")
    for name in [*names, "all"]:
        kept = [index for index, folder in enumerate(scores.folders) if name in (folder, "all")]
        cells = "".join(_cells([found[index] for index in kept]) for found in (scores.alone, scores.held_out))
        lines.append(f"{name:<24}{len(kept):>6}{cells}")
    lines.append("false: segments on each frame without smoke; px: the centroid's median error, of what was found")
    return "\n".join(lines)


def _cells(scores: Sequence[ImageScore]) -> str:
    one = summarised(scores, [0.0])
    found = f"{round(one.found_share * one.smoke_images)} of {one.smoke_images}" if one.smoke_images else "-"
    numbers = f"{_number(one.false_per_negative, 2):>8}{_number(one.iou_mean, 2):>7}"
    return f"{found:>9}{numbers}{_number(one.centroid_error_px_median, 1):>6}"


def _number(value: float, digits: int) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"
