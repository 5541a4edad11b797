"""The command line's simulated drone: a recording of its flight, or itself, live."""

from pathlib import Path
from typing import Annotated

import typer

from service.commands.say import say


def simulate(
    out: Annotated[Path, typer.Argument(help="The new recording's folder.")],
    scenario: Annotated[str, typer.Option(help="A built-in name or a TOML file.")] = "demo",
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Write a recording of a simulated flight, with its truth."""
    from service.simulator.scenario import load_scenario
    from service.simulator.simulate import simulate as run_simulate

    settings = load_scenario(scenario)
    run_simulate(out, settings, seed, lambda share: None)
    say(f"wrote {out}")


def autopilot(
    connect: Annotated[
        list[str] | None,
        typer.Option(metavar="HOST:PORT", help="Where MAVLink goes by UDP; may be given again. [127.0.0.1:14550]"),
    ] = None,
    camera: Annotated[
        str, typer.Option(metavar="HOST:PORT", help="Where the camera's pictures are served by HTTP; empty: nowhere.")
    ] = "127.0.0.1:8090",
    pictures: Annotated[
        Path | None,
        typer.Option(
            help="Draw the pictures into this new folder, which is the camera; each service begins the flight anew."
        ),
    ] = None,
    seconds: Annotated[float, typer.Option(min=1.0, max=3600.0, help="Of flight that --pictures draws.")] = 180.0,
    scenario: Annotated[str, typer.Option(help="A built-in name or a TOML file.")] = "patrol",
    write_config: Annotated[
        Path | None, typer.Option(help="First write a config for `run` to this new file that fits this drone.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the simulated errors.")] = 1,
) -> None:
    """Simulate a drone, live: for `run`, for ground control software, or for a program of yours."""
    from service.commands.progress import count_progress
    from service.simulator import live_drone
    from service.simulator.pictures import draw_pictures
    from service.simulator.scenario import load_scenario

    settings = load_scenario(scenario)
    try:
        links = [live_drone.parse_host_port(one) for one in connect or ["127.0.0.1:14550"]]
        served = live_drone.parse_host_port(camera) if camera and pictures is None else None
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    if pictures is not None:
        count = max(1, round(seconds * settings.fps))
        with count_progress("pictures", count) as on_progress:
            draw_pictures(pictures, settings, seed, count, on_progress)
        say(f"wrote {count} pictures to {pictures}: {seconds:g} s of flight, begun anew with each service that starts")
    if write_config is not None:
        live_drone.write_config(write_config, live_drone.live_config_toml(settings, links[0], served, pictures))
        say(f"wrote {write_config}")
    live_drone.fly(settings, seed, links, served, say, is_begun_anew=pictures is not None)
