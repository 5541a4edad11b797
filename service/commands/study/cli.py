"""The command line's `study`: the paper's tables re-run, and what the settings do."""

import os
from pathlib import Path
from typing import Annotated

import typer

from service.commands.say import say

study = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

Runs = Annotated[int, typer.Option(min=1, max=10_000, help="Flights for each figure.")]
Jobs = Annotated[int, typer.Option(min=1, help="Processes.")]
Seed = Annotated[int, typer.Option(min=0)]
Out = Annotated[Path | None, typer.Option(help="Folder for the tables and plots; by default study/NAME.")]


_CORES = len(os.sched_getaffinity(0))


@study.callback()
def one_thread_each() -> None:
    """Re-run the paper's study: tables, plots and the bound."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is imported: the processes fill the cores


@study.command()
def table1(runs: Runs = 10, jobs: Jobs = _CORES, seed: Seed = 0, out: Out = None) -> None:
    """The paper's Table 1: five rows of noise by every method, beside its figures and the Cramer-Rao bound."""
    from service.commands.study.table1 import run_table1

    run_table1(out or Path("study/table1"), runs, jobs, seed, say)


@study.command()
def sensitivity(runs: Runs = 5, jobs: Jobs = _CORES, seed: Seed = 0, out: Out = None) -> None:
    """Error and ratio against particles, their noise, step distance, range and pose noise, each swept."""
    from service.commands.study.sensitivity import run_sensitivity

    run_sensitivity(out or Path("study/sensitivity"), runs, jobs, seed, say)


@study.command()
def coverage(
    runs: Runs = 100,
    jobs: Jobs = _CORES,
    seed: Annotated[int, typer.Option(min=0, help="The filter was tuned on 0 to 999.")] = 60_000,
    out: Out = None,
    classes: Annotated[
        str,
        typer.Option(help="boxes, main of these, groups or scenes of `study scenes`; all but the hour's by default."),
    ] = "",
) -> None:
    """Whether the 95 % ellipse holds the truth: boxes with every geometry and class of errors, fires as they are."""
    from distloc.study.coverage.classes import classes_named
    from service.commands.study.coverage import run_coverage

    try:
        chosen = classes_named(classes)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--classes") from error
    run_coverage(out or Path("study/coverage"), chosen, runs, jobs, seed, say)


@study.command()
def scenery(
    runs: Runs = 100,
    jobs: Jobs = _CORES,
    seed: Annotated[int, typer.Option(min=0, help="The filter was tuned on 0 to 999.")] = 62_000,
    out: Out = None,
) -> None:
    """What corners of the scenery add: error, ellipse, coverage and time to confirm with and without; the bounds."""
    from service.commands.study.scenery import run_scenery

    run_scenery(out or Path("study/scenery"), runs, jobs, seed, say)


@study.command()
def drawn(
    runs: Runs = 20,
    jobs: Jobs = _CORES,
    seed: Annotated[int, typer.Option(min=0, help="The filter was tuned on 0 to 999.")] = 64_000,
    out: Out = None,
    scenes: Annotated[str, typer.Option(help="Names with commas between them; by default all.")] = "",
) -> None:
    """Drawn frames through the real tracker: what the scenery adds or spoils on hills, sea, snow and at night."""
    from distloc.study.drawn.cases import cases_named
    from service.commands.study.drawn import run_drawn

    try:
        cases = cases_named(scenes)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--scenes") from error
    run_drawn(out or Path("study/drawn"), cases, runs, jobs, seed, say)


@study.command()
def scenes(
    runs: Runs = 20,
    jobs: Jobs = _CORES,
    seed: Annotated[int, typer.Option(min=0, help="The filter was tuned on 0 to 999.")] = 66_000,
    out: Out = None,
    scenes: Annotated[str, typer.Option(help="Scenes or groups with commas between them; by default all.")] = "",
) -> None:
    """Fires as they are: leaning, growing, hidden, cut, moving, many: is the fire in the ellipse, under one id?"""
    from distloc.study.fires.cases import scenes_named
    from service.commands.study.scenes import run_scenes

    try:
        cases = scenes_named(scenes)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--scenes") from error
    run_scenes(out or Path("study/scenes"), cases, runs, jobs, seed, say)


@study.command()
def advice(
    runs: Runs = 200,
    jobs: Jobs = _CORES,
    seed: Annotated[int, typer.Option(min=0, help="The advice was tuned on 0 to 999.")] = 72_000,
    out: Out = None,
) -> None:
    """Fly as advised, and by chance: is the promised half-length met, and is it worth flying?"""
    from service.commands.study.advice import run_advice

    run_advice(out or Path("study/advice"), runs, jobs, seed, say)


@study.command()
def fleets(
    fleets: Annotated[int, typer.Option(min=1, max=10_000, help="Drawn fleets.")] = 300,
    flown: Annotated[int, typer.Option(min=0, max=1_000, help="Fleets that the real localizer flies.")] = 20,
    jobs: Jobs = _CORES,
    seed: Annotated[int, typer.Option(min=0, help="The fusion was tuned on 0 to 1999.")] = 68_000,
    out: Out = None,
) -> None:
    """Two to five drones, one fire or two: is what is fused honest, better than the best, and who is wrong named?"""
    from service.commands.study.fleets import run_fleets

    run_fleets(out or Path("study/fleets"), fleets, flown, jobs, seed, say)


@study.command()
def sequence(
    recording: Annotated[Path, typer.Argument(help="A recording's folder, with truth.json.")],
    config: Annotated[Path | None, typer.Option(help="Used instead of the recording's own config.toml.")] = None,
    runs: Runs = 10,
    jobs: Jobs = _CORES,
    seed: Seed = 0,
    out: Out = None,
) -> None:
    """The paper's Table 2 for a recorded flight: each method's error against translation."""
    from service.commands.study.sequence.run import run_sequence_study

    run_sequence_study(recording, config, out or Path("study") / recording.resolve().name, runs, jobs, seed, say)


@study.command()
def segmentation(
    folders: Annotated[list[Path], typer.Argument(metavar="DIR", help="Images with masks, boxes.csv or neither.")],
    segmenter: Annotated[
        str, typer.Option(help="onnx (the model that ships), classical (no model), sobel (masts), or NAME.onnx.")
    ] = "onnx",
    out: Out = None,
    threshold: Annotated[float | None, typer.Option(help="What a model calls smoke, from 0 to 1.")] = None,
    config: Annotated[Path | None, typer.Option(help="Its [segmenter] says what a model takes and gives.")] = None,
) -> None:
    """How much smoke a segmenter finds in folders of images, how exactly, how often falsely, and how fast."""
    from service.commands.study.segmentation.run import run_segmentation

    run_segmentation(folders, segmenter, threshold, out or Path("study/segmentation"), say, config)


@study.command()
def alerts(
    folders: Annotated[
        list[Path], typer.Argument(metavar="DIR", help="Frames named ..._UNIX_+SECONDS, as segmentation.")
    ],
    segmenter: Annotated[
        str, typer.Option(help="onnx (the model that ships), classical (no model), sobel (masts), or NAME.onnx.")
    ] = "onnx",
    out: Out = None,
    thresholds: Annotated[str, typer.Option(help="Of a model, with commas between them; its own is added.")] = "",
    config: Annotated[Path | None, typer.Option(help="Its [segmenter] says what a model takes and gives.")] = None,
) -> None:
    """Seconds from ignition until a fixed camera's smoke is told of, against false alarms an hour, by the threshold."""
    from service.commands.study.alerts.run import checked_thresholds, run_alerts

    run_alerts(folders, segmenter, checked_thresholds(thresholds), out or Path("study/alerts"), say, config)


@study.command()
def fires(
    sightings: Annotated[
        list[Path],
        typer.Argument(help="Tables as locate takes, with a column fire: docs/study-fires.md."),
    ],
    ignitions: Annotated[
        Path | None, typer.Option(help="A table of where they began: fire, lat, lon; or ignition_lat, ignition_lon.")
    ] = None,
    out: Out = None,
    config: Annotated[Path | None, typer.Option(help="Its [camera] and [pose_errors] are of rows without.")] = None,
    dem: Annotated[Path | None, typer.Option(help="Elevation: .hgt, GeoTIFF or a folder of them.")] = None,
    ground_sigma: Annotated[float | None, typer.Option(min=0.1, max=1e4, help="Of the DEM's heights, metres.")] = None,
    geoid: Annotated[float | None, typer.Option(min=-120.0, max=120.0, help="Over the ellipsoid, metres.")] = None,
    max_range: Annotated[float, typer.Option(min=0.1, max=200.0, help="Nothing is farther than this, km.")] = 60.0,
    heading_bias: Annotated[
        float, typer.Option(min=0.01, max=45.0, help="Of rows that don't say, degrees, one standard deviation.")
    ] = 3.0,
    tilt_bias: Annotated[float, typer.Option(min=0.01, max=45.0, help="The same of roll and pitch.")] = 1.0,
    smoke_offset: Annotated[
        float, typer.Option(min=0.0, max=10_000.0, help="At least so far is the smoke seen from its fire, metres.")
    ] = 200.0,
) -> None:
    """Fires that really burned: does the 95 % region of their sightings hold where they began, and how large is it?"""
    from service.commands.study.ignitions.run import Nominal, run_fires
    from service.recordings.sightings.wanted import Wanted

    wanted = Wanted(config, out, dem, None, ground_sigma, geoid, None, max_range)
    nominal = Nominal(heading_bias, tilt_bias, smoke_offset)
    run_fires(sightings, ignitions, wanted, nominal, say, lambda line: say(line, err=True))
