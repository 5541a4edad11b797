"""The command line. Heavy imports wait until their command runs, so that --help answers at once."""

import io
import logging
import os
import signal
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from service.commands.calibrate.cli import calibrate
from service.commands.demo.simulated import autopilot, simulate
from service.commands.ground import ground
from service.commands.importing.cli import import_
from service.commands.locate.cli import locate
from service.commands.say import say
from service.commands.study.cli import study
from service.common.shown import ShownFormatter

if TYPE_CHECKING:
    import asyncio

EXIT_FAULT = 1
EXIT_CONFIG = 78

# no markup: it would take "[zenoh]" in a help text, or in what a user typed, for a style and swallow it
app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
app.add_typer(study, name="study")
_debug = {"on": False}


@app.callback()
def options(debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False) -> None:
    """Finds wildfire smoke in a drone's camera and says where on the map it is, and how sure it is."""
    _debug["on"] = debug
    os.environ.setdefault("OPENCV_LOG_LEVEL", "FATAL")  # our own line says it
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a name that the terminal's encoding lacks
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(ShownFormatter("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


@app.command()
def run(config: Annotated[Path, typer.Option(help="The configuration file (TOML).")]) -> None:
    """Run the service until it is told to stop."""
    from service.common import aio
    from service.config.load import load_config
    from service.flight.app import App

    service = App(load_config(config), config.read_text(encoding="utf-8"))
    aio.run(_until_signal(service.run))


async def _until_signal(serve: "Callable[[asyncio.Event], Awaitable[None]]") -> None:
    import asyncio

    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    await serve(stop)


@app.command()
def demo(
    duration: Annotated[float, typer.Option(min=5.0, help="Seconds of flight.")] = 40.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated errors.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for the reports and pictures.")] = Path("demo"),
    segmenter: Annotated[
        Literal["onnx", "classical"],
        typer.Option(help="onnx: the model that ships; classical: none, finds few real fires."),
    ] = "onnx",
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Don't show the fire on a page in the browser.")
    ] = False,
) -> None:
    """Locate a simulated fire: real MAVLink on a socket, rendered frames, the real service."""
    from service.commands.demo.demo import run_demo
    from service.config.sections import SegmenterConfig

    if not run_demo(out, duration, seed, SegmenterConfig(kind=segmenter), not no_browser):
        raise typer.Exit(EXIT_FAULT)


@app.command()
def replay(
    recording: Annotated[Path, typer.Argument(help="A recording's folder, or a bare .tlog file.")],
    config: Annotated[Path | None, typer.Option(help="Used instead of the recording's own config.toml.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; by default replay/NAME.")] = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="At the log's own speed.")] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Used instead of the config's localizer.seed.")] = None,
) -> None:
    """Run a recorded flight through the code that flies, and score it where the truth is known."""
    from service.commands.progress import log_progress
    from service.config.load import load_config
    from service.config.sections import Config
    from service.recordings.flights import newest_flight
    from service.recordings.recording import Recording, RecordingError
    from service.recordings.replay import replay as run_replay

    recording = newest_flight(recording, typer.echo)
    source = Recording(recording)
    path = config or source.config_path
    settings: Config = load_config(path) if path else Config()
    folder = out or Path("replay") / (recording.resolve().stem)
    with log_progress(recording.name) as on_progress:
        score, outcome = run_replay(source, settings, folder, seed=seed, realtime=realtime, on_progress=on_progress)
    say(f"wrote {folder}/reports.jsonl, targets.geojson, status.json" + (", score.json" if score else ""))
    for one in score.targets if score else []:
        say(str(one))
    if not outcome.is_useful:
        raise RecordingError(f"{recording}: nothing could be used: {outcome}")
    if outcome.mount:
        say(outcome.mount)
    say(str(outcome))


app.command()(simulate)
app.command()(autopilot)
app.command()(calibrate)
app.command()(ground)
app.command(name="import")(import_)
app.command()(locate)


@app.command()
def check(
    config: Annotated[Path | None, typer.Option(help="The configuration file (TOML).")] = None,
    model: Annotated[Path | None, typer.Option(help="Try this ONNX model, as the config's segmenter would.")] = None,
    image: Annotated[Path | None, typer.Option(help="An image that the model looks at.")] = None,
    out: Annotated[Path, typer.Option(help="The image with what was found drawn in.")] = Path("overlay.png"),
    seconds: Annotated[float, typer.Option(min=1.0, max=3600.0, help="How long to listen and look.")] = 8.0,
) -> None:
    """Say of config, model, camera, links, clocks, zenoh and disk what is wrong and how to mend it."""
    from service.config.load import load_config
    from service.config.sections import Config

    settings = load_config(config) if config else None
    if model or image:
        from service.commands.check.model import run_check_model

        is_well = run_check_model(model, image, out, settings, say)
    else:
        from service.commands.check.doctor import run_check
        from service.common import aio

        is_well = aio.run(run_check(settings or Config(), say, seconds))
    if not is_well:
        raise typer.Exit(EXIT_FAULT)


Root = Annotated[Path, typer.Option(help="An image's root folder instead of the running system.")]
Yes = Annotated[bool, typer.Option("--yes", help="Do it; without it, it is only said what would be done.")]


@app.command()
def install(
    root: Root = Path("/"),
    yes: Yes = False,
    jetson: Annotated[bool, typer.Option("--jetson", help="Add the drop-in for a Jetson's GPU.")] = False,
    pi: Annotated[bool, typer.Option("--pi", help="Add the drop-in for a Raspberry Pi's CSI camera.")] = False,
    is_ground: Annotated[bool, typer.Option("--ground", help="The ground station's service, not the drone's.")] = False,
    exec_: Annotated[
        str | None, typer.Option("--exec", help="Absolute path of distloc in the unit; by default this one's own.")
    ] = None,
) -> None:
    """Install the systemd unit, its user and a commented config; says what it would do unless --yes."""
    from service.commands.install import install as installer
    from service.commands.install.board_limits import read_board

    profiles = [name for name, is_asked in (("jetson", jetson), ("pi", pi)) if is_asked]
    if profiles and is_ground:
        raise typer.BadParameter("is for the drone's service", param_hint=f"--{profiles[0]}")
    try:
        board = read_board() if root == Path("/") else None  # an image's board is not this one
        installer.install(installer.check_rights(root, yes), exec_, yes, say, profiles, board, is_ground)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


@app.command()
def uninstall(
    root: Root = Path("/"),
    yes: Yes = False,
    purge: Annotated[bool, typer.Option("--purge", help="Remove the config and the recorded state as well.")] = False,
    is_ground: Annotated[bool, typer.Option("--ground", help="The ground station's service, not the drone's.")] = False,
) -> None:
    """Remove what `install` wrote and nobody changed; says what it would do unless --yes."""
    from service.commands.install import install as installer

    installer.uninstall(installer.check_rights(root, yes), purge, yes, say, is_ground)


@app.command()
def bench(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="Measure filter, targets, literal, published, stages, scenery, pipeline, service or ground; "
            "may be given again.",
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=1.0, max=86_400.0, help="How long the ground's CPU and memory are measured.")
    ] = 30.0,
) -> None:
    """Time all that distloc does on this machine, beside published libraries and the machine's own limits."""
    from service.commands.bench.run import Sizes, parts_of, run_bench

    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # and what it started ends with it
    try:
        parts = parts_of(only or ())
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--only") from error
    run_bench(as_json, parts, say, Sizes(ground_s=seconds))


@app.command()
def soak(
    minutes: Annotated[float, typer.Option(min=0.1, max=1440.0, help="How long to fly, in true time.")],
    speed: Annotated[
        float,
        typer.Option(
            min=0.5,
            max=10.0,
            help="Times 10 frames and 200 messages a second: N minutes bear the load of SPEED times N.",
        ),
    ] = 1.0,
    out: Annotated[Path, typer.Option(help="Folder for soak.json, soak.csv and soak.png.")] = Path("soak"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the faults and of the simulated errors.")] = 1,
    segmenter: Annotated[
        Literal["onnx", "classical"],
        typer.Option(help="onnx: the model that ships; classical: none, finds few real fires."),
    ] = "onnx",
) -> None:
    """Fly the whole service with faults sprinkled in; record memory, CPU and latency, and judge them."""
    from service.commands.soak.command import run_soak
    from service.commands.soak.flight import Settings
    from service.config.sections import SegmenterConfig

    settings = Settings(minutes, speed, seed, SegmenterConfig(kind=segmenter))
    if not run_soak(out, settings, say).verdict.passed:
        raise typer.Exit(EXIT_FAULT)


def main() -> None:
    """Run a command; an error is one line on stderr and the right exit code."""
    try:
        app()
    except (KeyboardInterrupt, BrokenPipeError):
        os._exit(EXIT_FAULT)
    except Exception as error:
        if _debug["on"]:
            raise
        from service.commands.errors import described, exit_code

        say(f"distloc: {described(error)}", err=True)
        raise SystemExit(exit_code(error)) from None
