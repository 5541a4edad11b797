"""The alert study's results as files and as a table on the screen."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from distloc.study.alerts.places import LEVELS
from distloc.study.alerts.summary import Alerts, pooled
from distloc.study.alerts.watch import LONGEST_GAP_S, Watched
from distloc.tracks.life import CONFIRM_SIGHTINGS, CONFIRM_WINDOW
from distloc.tracks.pool import REPORT_SIGHTINGS, REPORT_WINDOW
from service.commands.study.files import cell, rounded, write_csv, write_json
from service.common.files import write_whole

_GAP_MIN = LONGEST_GAP_S / 60.0
_TENTATIVE, _CONFIRMED = f"{REPORT_SIGHTINGS} of {REPORT_WINDOW}", f"{CONFIRM_SIGHTINGS} of {CONFIRM_WINDOW}"
_NOTES = f"""\
Seconds from the ignition, as the frames' names have it, to the first segment on the smoke, to the first one at a place
that is tentative, and at one that is confirmed: medians over the fires, a dash where most were never told of. By the
tracker's own counts, at one place of the image, a segment in {_TENTATIVE} frames makes it tentative, in {_CONFIRMED}
confirmed: so the time between two frames sets the least. told: fires told of. false/h: places that came to the level
up to the ignition, a camera-hour; gaps of over {_GAP_MIN:.0f} min are not watched. own: the model's threshold."""


def write_alerts(
    out: Path,
    watched: Mapping[str, Mapping[float | None, Watched]],
    segmenter: str,
    own: float | None,
    say: Callable[[str], None],
) -> None:
    """alerts.json, .csv, .txt and .png in `out`; `watched` by sequence and threshold, none of them empty."""
    from distloc.study.alerts.plots import alerts_figure
    from distloc.study.plots import png_from_figure

    thresholds = sorted({at for ones in watched.values() for at in ones}, key=lambda at: at or 0.0)
    curve = [pooled(at, [ones[at] for ones in watched.values() if at in ones]) for at in thresholds]
    rules = {"tentative": _TENTATIVE, "confirmed": _CONFIRMED}
    rows = [_row(name, at, one) for name, ones in watched.items() for at, one in ones.items()]
    content = {"segmenter": segmenter, "own_threshold": own, "frames_at_one_place": rules}
    write_json(out / "alerts.json", content | {"curve": [_curve_row(one) for one in curve], "sequences": rows})
    write_csv(out / "alerts.csv", rows)
    text = _text(segmenter, own, curve, len(watched))
    write_whole(out / "alerts.txt", f"{text}\n".encode())
    say(text)
    write_whole(out / "alerts.png", png_from_figure(alerts_figure(curve, segmenter)))
    say(f"wrote {out}/alerts.json, .csv, .txt and .png")


def _row(name: str, threshold: float | None, one: Watched) -> dict[str, Any]:
    return (
        {"sequence": name, "threshold": threshold, "frames_before": one.frames[0], "frames_after": one.frames[1]}
        | {"hours_before": rounded(one.hours, 4)}
        | {f"{level}_after_s": rounded(at, 1) for level, at in zip(LEVELS, one.after_s, strict=True)}
        | {f"{level}_false": count for level, count in zip(LEVELS, one.false, strict=True)}
    )


def _curve_row(one: Alerts) -> dict[str, Any]:
    row: dict[str, Any] = {"threshold": one.threshold, "fires": one.fires, "hours_before": rounded(one.hours, 4)}
    for number, level in enumerate(LEVELS):
        row |= {
            f"{level}_told": one.told[number],
            f"{level}_after_s": rounded(one.after_s[number], 1),
            f"{level}_false": one.false[number],
            f"{level}_false_per_hour": rounded(one.false_per_hour[number], 3),
        }
    return row


def _text(segmenter: str, own: float | None, curve: Sequence[Alerts], count: int) -> str:
    first = curve[0]
    of_level = f"{'told':>6}{'s':>7}{'false/h':>9}"
    return "\n".join(
        [
            f"segmenter: {segmenter}; {count} sequences, {first.fires} fires, {first.hours:.2f} camera-hours before",
            f"{'':9}" + "".join(f"  {level:>22}" for level in LEVELS),
            f"threshold{f'  {of_level}' * len(LEVELS)}",
            *(_line(one, own) for one in curve),
            "",
            _NOTES,
        ]
    )


def _line(one: Alerts, own: float | None) -> str:
    at = "-" if one.threshold is None else f"{one.threshold:g}"
    levels = (
        f"  {one.told[number]:>6}{cell(one.after_s[number], 7, 0)}{cell(one.false_per_hour[number], 9, 1)}"
        for number in range(len(LEVELS))
    )
    return f"{at:>9}{''.join(levels)}{'  own' if own is not None and one.threshold == own else ''}"
