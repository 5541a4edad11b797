"""The command line's `locate`."""

import os
from pathlib import Path
from typing import Annotated

import typer

from service.commands.say import say

_CORES = len(os.sched_getaffinity(0))


def locate(
    sightings: Annotated[
        list[Path],
        typer.Argument(help="Tables, CSV or GeoJSON: a row for each sighting. docs/locate.md has the columns."),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for places.geojson, .kml, .csv and map.png.")] = None,
    config: Annotated[
        Path | None, typer.Option(help="A config file: its [camera] and [pose_errors] are those of rows without.")
    ] = None,
    dem: Annotated[Path | None, typer.Option(help="Elevation: .hgt, GeoTIFF or a folder of them.")] = None,
    ground: Annotated[float | None, typer.Option(help="Instead: the ground's height near the cameras, metres.")] = None,
    ground_sigma: Annotated[
        float | None,
        typer.Option(min=0.1, max=1e4, help="One standard deviation of it: 15 for --dem, 30 for --ground."),
    ] = None,
    geoid: Annotated[
        float | None, typer.Option(min=-120.0, max=120.0, help="The geoid's height over the ellipsoid, metres.")
    ] = None,
    home: Annotated[
        tuple[float, float] | None, typer.Option(metavar="LAT LON", help="Near the cameras: finds swapped columns.")
    ] = None,
    max_range: Annotated[float, typer.Option(min=0.1, max=200.0, help="Nothing is farther than this, km.")] = 60.0,
    smoke_offset: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=10_000.0,
            help="How far smoke that was marked is from its fire at least, metres: 200 for boxes, else 0.",
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Processes that share the work of many targets.")] = _CORES,
) -> None:
    """Say where the things are that a table of sightings shows, how sure that is, and what would make it surer."""
    from service.commands.locate.run import run_locate
    from service.recordings.sightings.wanted import Wanted

    if dem is not None and ground is not None:
        raise typer.BadParameter("--dem and --ground: give one of them")
    wanted = Wanted(config, out, dem, ground, ground_sigma, geoid, home, max_range, smoke_offset)
    run_locate(sightings, wanted, say, lambda line: say(line, err=True), jobs)
