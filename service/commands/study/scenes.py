"""`study scenes`: fires as they are. Fly them, print the table, write CSV, JSON and the picture."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from distloc.study.fires.cases import GROUPS, SceneCase
from distloc.study.fires.flights import PARTICLES, fly_all
from distloc.study.fires.ledger import SceneTrack
from distloc.study.fires.summary import SceneSummary, pooled, summarised
from service.commands.progress import count_progress
from service.commands.study.files import cell, load_plots, prepared, rounded, write_csv, write_json
from service.common.files import write_whole

_NOTES = """\
A fire's place is its source's on the ground; confirmed: or coasting. conf.: share of runs with a confirmed report of a
fire; steps: share of the steps since a fire was first in view with anything confirmed. cover.: share of the fires'
confirmed reports whose 95 % ellipse holds the fire, then in each third of the flight. held: fires with a confirmed
target at the end; in: of these, the ellipse holds the fire then. error and half-length of the ellipse: medians at each
fire's last confirmed report, in % of the range. ids: confirmed targets a fire; switch: changes of a fire's target a
run; false: confirmed targets a run that are no fire's; all ids: targets reported in any state a run. told, conf. at:
medians in seconds from a fire's first sight to the first report in any state that points at it, and to the first
confirmed one; a dash where most fires have none. Lines with a star pool a whole group."""
_COVERED = """\
Of the confirmed and coasting reports of fires' targets: the share whose 95 % ellipse holds the fire, the interval of
that, to which a seed counts once, as its reports and scenes share their errors, and the mean NEES, 2 if the covariance
is true. error and half-length of the ellipse: medians at each fire's last one, in % of the range; conf.: share of runs
with one. Lines with a star pool a whole group."""


def run_scenes(
    out: Path,
    cases: Sequence[SceneCase],
    runs: int,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
    n_particles: int = PARTICLES,
    length_share: float = 1.0,
) -> None:
    """scenes.json, .csv, .txt (the table) and .png in `out`; `length_share` cuts each flight short."""
    load_plots()
    prepared(out)
    started = time.monotonic()
    with count_progress("scenes", len(cases) * runs) as on_done:
        flights = fly_all(cases, runs, jobs, seed, on_done, n_particles, length_share)
    write_scenes(out, {case.name: ones for case, ones in zip(cases, flights, strict=True)}, say)
    say(f"{runs} runs a scene in {time.monotonic() - started:.0f} s; wrote {out}/scenes.json, .csv, .txt and .png")


def write_scenes(out: Path, tracks: dict[str, list[SceneTrack]], say: Callable[[str], None]) -> None:
    """The table and the picture of scenes by name, and of the groups that are whole."""
    text = "\n".join([_head(), *(_line(row) for row in _written(out, tracks)), "", _NOTES])
    write_whole(out / "scenes.txt", f"{text}\n".encode())
    say(text)


def cover_scenes(
    out: Path,
    cases: Sequence[SceneCase],
    runs: int,
    jobs: int,
    seed: int,
    say: Callable[[str], None],
    n_particles: int,
    length_share: float,
) -> None:
    """The same as classes of `study coverage`: scenes.json, .csv and .png, and a table of what the ellipses hold."""
    with count_progress("coverage, scenes", len(cases) * runs) as on_done:
        flights = fly_all(cases, runs, jobs, seed, on_done, n_particles, length_share)
    rows = _written(out, {case.name: ones for case, ones in zip(cases, flights, strict=True)})
    head = f"{'scene':29}{'runs':>5}{'conf.':>6}{'reports':>8}{'coverage':>9}  {'95 % of it':13}{'NEES':>6}"
    say("\n".join([f"{head}{'error %':>8}{'half %':>7}", *(_covered(row) for row in rows), "", _COVERED]))


def _written(out: Path, tracks: dict[str, list[SceneTrack]]) -> list[dict[str, Any]]:
    """scenes.json, .csv and .png: a row a scene and group."""
    from distloc.study.fires.plots import scenes_figure
    from distloc.study.plots import png_from_figure

    groups = {group: [case.name for case in cases] for group, cases in GROUPS.items()}
    found = {name: summarised(ones) for name, ones in tracks.items()}
    found |= {f"*{group}": one for group, one in pooled(groups, tracks).items()}
    rows = [_row(name, one) for name, one in found.items()]
    write_json(out / "scenes.json", rows)
    write_csv(out / "scenes.csv", rows)
    write_whole(out / "scenes.png", png_from_figure(scenes_figure(found)))
    return rows


def _row(name: str, found: SceneSummary) -> dict[str, Any]:
    first, second, last = found.third_coverages
    return {
        "scene": name,
        "runs": found.runs,
        "fires": found.fires,
        "confirmed_runs": rounded(found.confirmed_runs, 4),
        "confirmed_steps": rounded(found.confirmed_steps, 4),
        "reports": found.reports,
        "coverage": rounded(found.coverage, 4),
        "coverage_low": rounded(found.coverage_low, 4),
        "coverage_high": rounded(found.coverage_high, 4),
        "mean_nees": rounded(found.mean_nees, 3),
        "coverage_first_third": rounded(first, 4),
        "coverage_second_third": rounded(second, 4),
        "coverage_last_third": rounded(last, 4),
        "held_share": rounded(found.held_share, 4),
        "held_coverage": rounded(found.held_coverage, 4),
        "median_error_share": rounded(found.median_error_share, 5),
        "median_half_share": rounded(found.median_half_share, 5),
        "ids_a_fire": rounded(found.ids_a_fire, 3),
        "switches_a_run": rounded(found.switches_a_run, 3),
        "false_a_run": rounded(found.false_a_run, 3),
        "ids_a_run": rounded(found.ids_a_run, 2),
        "told_after_s": rounded(found.told_after_s, 1),
        "confirmed_after_s": rounded(found.confirmed_after_s, 1),
    }


def _head() -> str:
    return (
        f"{'scene':29}{'runs':>5}{'fires':>6}{'conf.':>6}{'steps':>6}{'cover.':>7}  {'in each third':16}"
        f"{'held':>5}{'in':>6}{'error %':>8}{'half %':>7}{'ids':>5}{'switch':>7}"
        f"{'false':>6}{'all ids':>8}{'told':>6}{'conf. at':>9}"
    )


def _line(row: dict[str, Any]) -> str:
    thirds = "".join(cell(row[f"coverage_{third}_third"], 5, 2) for third in ("first", "second", "last"))
    return (
        f"{row['scene']:29}{row['runs']:>5}{row['fires']:>6}{cell(row['confirmed_runs'], 6, 2)}"
        f"{cell(row['confirmed_steps'], 6, 2)}{cell(row['coverage'], 7, 3)} {thirds}  "
        f"{cell(row['held_share'], 5, 2)}{cell(row['held_coverage'], 6, 2)}"
        f"{_percent(row['median_error_share'], 8)}{_percent(row['median_half_share'], 7)}"
        f"{cell(row['ids_a_fire'], 5, 1)}{cell(row['switches_a_run'], 7, 1)}{cell(row['false_a_run'], 6, 1)}"
        f"{cell(row['ids_a_run'], 8, 1)}{cell(row['told_after_s'], 6, 0)}{cell(row['confirmed_after_s'], 9, 0)}"
    )


def _covered(row: dict[str, Any]) -> str:
    interval = f"{row['coverage_low']:.3f}-{row['coverage_high']:.3f}"
    return (
        f"{row['scene']:29}{row['runs']:>5}{cell(row['confirmed_runs'], 6, 2)}{row['reports']:>8}"
        f"{cell(row['coverage'], 9, 3)}  {interval:13}{cell(row['mean_nees'], 6, 2)}"
        f"{_percent(row['median_error_share'], 8)}{_percent(row['median_half_share'], 7)}"
    )


def _percent(share: float | None, width: int) -> str:
    return cell(None if share is None else 100.0 * share, width, 1)
