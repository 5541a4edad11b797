"""The model's card: what it is, what it was trained on, how well it does by fire, where it fails."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.study.segmentation import ImageScore, share_error, summarised

MOST_FALSE, MOST_FALSE_BESIDE = 0.1, 0.2  # segments in a frame without smoke, and beside it in one with
OUTLINE_THRESHOLD = 0.5  # of a segment's edge
MARGIN = 0.5  # of these, for what ships: other fires had more than those of validation
_HEAD = """# {name}

Smoke of wildfires in the frames of a drone or a mast by day, from colour alone. Version {version}, {kilobytes} KB.

sha256 `{digest}`

- **Takes** RGB, 0 to 255 times 1/255, N C H W; height and width are multiples of 32, about {size} pixels in all,
  in the frame's own proportions and never enlarged (`distloc.resize` = `budget`).
- **Gives** logits of smoke at half that size; threshold {threshold}; a segment with some of it over that reaches as
  far as what is over {outline}.
- **Made** by `python models/training/train.py {command}`{real}
- **Licence** Apache-2.0, as the project; the generated frames are the project's own.
"""
_LIMITS = Path(__file__).with_name("limits.md")
_REAL = """
## Real frames

{credits}

## Scores on real frames

A frame is found where a segment's centroid lies in the smoke's mask or box, or within 10 px of it at 512 px of
width; any other segment is false. No frame was scored by a network that was fitted to its day, its camera or its
clip. `validation`: by one network that saw none of the fires of {validation}; the threshold was chosen
on these alone: the least with at most {most_false} false segments on a frame without smoke, {most_beside} on one with,
half of what is allowed.
{others} Frames of one fire are alike: the error of a share found
is that of so many fires, not frames.{known}

```
{table}
```

By fire, for the sets that nothing was fitted to ({measured}):

```
{fires}
```

By the threshold, on validation and on all that was cross-validated:

```
{sweep}
```
"""
_CROSS_VALIDATION = """# Cross-validation by fire and camera

{folds} networks, each made by `python models/training/train.py {command}`
(folders as on the [card](smoke-seg.md)), and each scored on the frames of its own fold alone: it was fitted to
nothing of their days, cameras or clips, and to none of the fires of {validation}. None of them ships.
The threshold, {threshold}, is the least with at most {most_false} false segments on a frame without smoke and
{most_beside} on one with, on all of these frames together.{known}

```
{table}
```

By fire, for the sets that nothing was fitted to ({measured}):

```
{fires}
```

By the threshold:

```
{sweep}
```
"""
_FOLDS = """`cross-validated`: by {folds} networks, which saw no fire of `validation` either. The one that ships saw
all frames that may be fitted to."""
_NO_FOLDS = (
    "The validated network is the one that ships; it saw all other frames that may be fitted to. What networks of\n"
    "fewer steps make of fires that they did not see: [cross-validation.md](cross-validation.md)."
)
_KNOWN = """

\\* The model that the fitting began with was fitted to {start_saw}:
it saw other frames of this day or this camera, or this very frame. Only what has no star is of fires and cameras that
no network saw."""
_CREDITS = {
    "smoke_hpwren_smokeseg": "smoke_hpwren_smokeseg: frames by HPWREN (https://www.hpwren.ucsd.edu/), masks of "
    "SmokeSeg by the authors of FoSp (MIT, github LujianYao/FoSp)",
    "smoke_hpwren_drawn": "smoke_hpwren_drawn: frames by HPWREN (https://www.hpwren.ucsd.edu/), outlined by the "
    "project (training/smoke_hpwren.outlines.txt)",
    "smoke_hpwren_boxes": "smoke_hpwren_boxes: **measured on, not fitted to**: frames by HPWREN, boxes by AI For "
    "Mankind with HPWREN (CC BY-NC-SA 4.0)",
    "smoke_hpwren_sequence": "smoke_hpwren_sequence: FIgLib, by HPWREN (https://www.hpwren.ucsd.edu/)",
    "negatives_hpwren_sequence": "negatives_hpwren_sequence: FIgLib, by HPWREN, the same camera before the fire",
    "smoke_boreal_uav": "smoke_boreal_uav: Boreal Forest Fire dataset (CC BY 4.0, doi 10.23729/fd-72c6cf74-b8eb-3687-"
    "860d-bf93a1ab94c9); its boxes were made masks by their brightness",
    **{
        name: f"{name}: horizon-detection-for-uav (MIT, github NovelioPI)"
        for name in ("negatives_horizon_uav", "negatives_horizon_uav_more", "negatives_horizon_uav_b")
    },
}


@dataclass(frozen=True, slots=True)
class Scored:
    """A frame: its folder, its fire or clip, its fold (0: validation); `is_fitted` unless it is measured on only.

    `is_known`: the model that the fitting began with saw its day, its camera or its clip.
    """

    folder: str
    fire: str
    fold: int
    is_fitted: bool
    is_known: bool


@dataclass(frozen=True, slots=True)
class Scores:
    """Frames, and by threshold each one's score by a network that held it out; `fitted` names the folders fitted to.

    `start_saw` are those of them that the model was fitted to with which the fitting began.
    """

    fitted: Sequence[str]
    frames: Sequence[Scored]
    held_out: Mapping[float, Sequence[ImageScore]]
    validation: Sequence[str]
    start_saw: Sequence[str]

    def threshold(self, margin: float = 1.0) -> float:
        """The least at which few things are taken for smoke: on validation, or on all where none is of validation.

        `margin` is the share of what is allowed.
        """
        chosen = [index for index, one in enumerate(self.frames) if one.fold == 0] or range(len(self.frames))
        few = []
        for threshold, scores in self.held_out.items():
            one = summarised([scores[index] for index in chosen], [0.0])
            if not (
                one.false_per_negative > margin * MOST_FALSE or one.false_per_smoke_image > margin * MOST_FALSE_BESIDE
            ):
                few.append(threshold)
        return min(few, default=max(self.held_out))


def write_card(
    path: Path,
    model: Path,
    version: str,
    digest: str,
    threshold: float,
    size: str,
    command: str,
    scores: Scores,
) -> None:
    """Markdown at `path`; without real frames there is nothing to say of them."""
    fitted, folds = scores.fitted, max((one.fold for one in scores.frames), default=0)
    measured = sorted({one.folder for one in scores.frames if not one.is_fitted})
    real = " --real " + " ".join(fitted) + (" --measure " + " ".join(measured) if measured else "") if fitted else ""
    text = _HEAD.format(
        name=model.name,
        version=version,
        kilobytes=model.stat().st_size // 1024,
        digest=digest,
        threshold=threshold,
        outline=OUTLINE_THRESHOLD,
        size=size,
        command=command,
        real=real,
    )
    if fitted:
        text += _REAL.format(
            credits="\n".join(f"- {_CREDITS.get(name, name)}" for name in [*fitted, *measured]),
            validation=", ".join(scores.validation),
            most_false=MARGIN * MOST_FALSE,
            most_beside=MARGIN * MOST_FALSE_BESIDE,
            others=_FOLDS.format(folds=folds) if folds else _NO_FOLDS,
            table=_table(scores, threshold),
            known=_KNOWN.format(start_saw=", ".join(scores.start_saw)) if scores.start_saw else "",
            measured=", ".join(measured),
            fires=_by_fire(scores, threshold),
            sweep=_sweep(scores),
        )
    path.write_text(text + _LIMITS.read_text())


def write_cross_validation(path: Path, command: str, scores: Scores) -> None:
    """Markdown at `path` of what the folds' networks found; `scores` has nothing of validation."""
    threshold = scores.threshold()
    text = _CROSS_VALIDATION.format(
        folds=len({one.fold for one in scores.frames}),
        command=command,
        validation=", ".join(scores.validation),
        threshold=threshold,
        most_false=MOST_FALSE,
        most_beside=MOST_FALSE_BESIDE,
        known=_KNOWN.format(start_saw=", ".join(scores.start_saw)) if scores.start_saw else "",
        table=_table(scores, threshold),
        measured=", ".join(sorted({one.folder for one in scores.frames if not one.is_fitted})),
        fires=_by_fire(scores, threshold),
        sweep=_sweep(scores),
    )
    path.write_text(text)


_COLUMNS = f"{'frames':>8}{'fires':>7}{'found':>12}{'share':>14}{'beside':>8}{'false':>8}{'px':>6}"


def _table(scores: Scores, threshold: float) -> str:
    lines = [f"{'':<46}{_COLUMNS}"]
    for part, is_part in (("validation", lambda fold: fold == 0), ("cross-validated", lambda fold: fold > 0)):
        for folder in sorted({one.folder for one in scores.frames}):
            of_part = [i for i, one in enumerate(scores.frames) if one.folder == folder and is_part(one.fold)]
            for star, is_known in (("", False), (" *", True)):
                kept = [i for i in of_part if scores.frames[i].is_known == is_known]
                if kept:
                    lines.append(f"{part:<17}{folder + star:<29}{_cells(scores, kept, threshold)}")
    lines.append(
        "share: found, with the standard error by fire; beside: false segments on each frame with smoke; false: on each"
    )
    lines.append("frame without; px: the centroid's median error, of what was found")
    return "\n".join(lines)


def _by_fire(scores: Scores, threshold: float) -> str:
    lines = [f"{'':<46}{_COLUMNS}"]
    measured = {(one.fold, one.fire) for one in scores.frames if not one.is_fitted}
    for fold, fire in sorted(measured):
        kept = [i for i, one in enumerate(scores.frames) if one.fire == fire and not one.is_fitted]
        part, star = (
            "cross-validated" if fold else "validation",
            " *" if any(scores.frames[i].is_known for i in kept) else "",
        )
        lines.append(f"{part:<17}{fire + star:<29}{_cells(scores, kept, threshold)}")
    return "\n".join(lines)


def _sweep(scores: Scores) -> str:
    parts = [[i for i, one in enumerate(scores.frames) if (one.fold == 0) == is_validation] for is_validation in (1, 0)]
    lines = [f"{'threshold':<12}" + 2 * f"{'found':>14}{'beside':>8}{'false':>8}"]
    for threshold, found in scores.held_out.items():
        line = f"{threshold:<12}"
        for kept in parts:
            one = summarised([found[i] for i in kept], [0.0])
            count = f"{round(one.found_share * one.smoke_images)} of {one.smoke_images}" if one.smoke_images else "-"
            line += f"{count:>14}{_number(one.false_per_smoke_image, 2):>8}{_number(one.false_per_negative, 2):>8}"
        lines.append(line)
    return "\n".join(lines)


def _cells(scores: Scores, kept: Sequence[int], threshold: float) -> str:
    found = [scores.held_out[threshold][index] for index in kept]
    one = summarised(found, [0.0])
    fires = sorted({scores.frames[index].fire for index in kept})
    count, share = "-", "-"
    if one.smoke_images:
        count = f"{round(one.found_share * one.smoke_images)} of {one.smoke_images}"
        by_fire = [[s for i, s in zip(kept, found, strict=True) if scores.frames[i].fire == fire] for fire in fires]
        error = share_error([[s.is_found for s in of_fire if s.is_smoke] for of_fire in by_fire])
        share = f"{one.found_share:.2f}" + ("" if np.isnan(error) else f" ± {error:.2f}")
    rates = f"{_number(one.false_per_smoke_image, 2):>8}{_number(one.false_per_negative, 2):>8}"
    return f"{len(kept):>8}{len(fires):>7}{count:>12}{share:>14}{rates}{_number(one.centroid_error_px_median, 1):>6}"


def _number(value: float, digits: int) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"
