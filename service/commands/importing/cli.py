"""The command line's `import`."""

from pathlib import Path
from typing import Annotated

import typer

from service.commands.say import say


def import_(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE...",
            help="One flight's files: a log and its film, an .SRT and its film, a folder of stills, a table of poses "
            "and a film. docs/import.md has what can be read.",
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="The new recording's folder.")] = None,
    sightings: Annotated[
        Path | None,
        typer.Option(help="A new table for `distloc locate`, a row for each picture: mark the smoke in u_px, v_px."),
    ] = None,
    attitude: Annotated[
        Path | None, typer.Option(help="A log or a table whose attitudes count instead of the sources' own.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="A config file: what it has of camera, mount and errors is taken as it stands.")
    ] = None,
    mount: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="YAW PITCH ROLL", help="Angles of the camera in the craft, or in the gimbal, degrees."),
    ] = None,
    mount_sigma: Annotated[
        float | None, typer.Option(min=0.01, max=90.0, help="One standard deviation of these, degrees.")
    ] = None,
    hfov: Annotated[
        float | None, typer.Option(min=0.5, max=170.0, help="The lens' horizontal view, degrees, where not told.")
    ] = None,
    by_course: Annotated[
        bool, typer.Option("--by-course", help="Without an attitude: level, the nose along the course.")
    ] = False,
    time_offset: Annotated[
        float | None,
        typer.Option(
            min=-1e6,
            max=1e6,
            help="Seconds by which the frames are later than their times say; of frames that are tied to no clock, "
            "by which the first one is later than the first pose. Nothing is searched then.",
        ),
    ] = None,
    utc_offset: Annotated[
        float | None, typer.Option(min=-14.0, max=14.0, help="Hours, local time minus UTC, of times without a zone.")
    ] = None,
    geoid: Annotated[
        float | None, typer.Option(min=-120.0, max=120.0, help="The geoid's height over the ellipsoid, metres.")
    ] = None,
    home_alt: Annotated[
        float | None, typer.Option(min=-1000.0, max=9000.0, help="Home's height over the sea, metres, where not told.")
    ] = None,
) -> None:
    """Make a recording of others' logs, films and stills, and say what was found, what lacks and what was assumed."""
    from service.commands.importing.run import Wanted, run_import

    wanted = Wanted(
        out,
        attitude,
        config,
        mount,
        mount_sigma,
        hfov,
        by_course,
        time_offset,
        utc_offset,
        geoid,
        home_alt,
        sightings,
    )
    run_import(sources, wanted, say)
