"""The command line's `calibrate`."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from service.commands.say import say


def _on_earth(place: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
    lat_deg, lon_deg, alt_msl_m = place or (0.0, 0.0, 0.0)
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0 and -1000.0 <= alt_msl_m <= 50_000.0):
        raise typer.BadParameter(
            f"{lat_deg:g} {lon_deg:g} {alt_msl_m:g} is no place: LAT is -90 to 90, LON -180 to 180 degrees, ALT metres"
        )
    return place


def calibrate(
    recording: Annotated[Path, typer.Argument(help="A recorded flight with pictures.")],
    landmark: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="LAT LON ALT",
            help="A mast, chimney or peak: the middle of the part that the segmenter marks (half-way up a mast that "
            "stands free), in degrees and metres above mean sea level. Without one the scenery tells.",
            callback=_on_earth,
        ),
    ] = None,
    time_offset: Annotated[bool, typer.Option("--time-offset", help="Also how late the frames are stamped.")] = False,
    config: Annotated[Path | None, typer.Option(help="Used instead of the recording's own config.toml.")] = None,
    segmenter: Annotated[
        Literal["onnx", "classical", "sobel", "recorded"] | None,
        typer.Option(help="Instead of the config's: sobel for masts, recorded for masks of your own."),
    ] = None,
    cut_template: Annotated[
        Path | None, typer.Option(help="Instead of all that, cut a template for [[landmarks]] into this PNG file.")
    ] = None,
    at: Annotated[
        tuple[float, float] | None, typer.Option(metavar="U V", help="The template's middle, in pixels of the frame.")
    ] = None,
    frame: Annotated[int, typer.Option(min=0, help="Which frame it is cut from; 0 is the first.")] = 0,
    side: Annotated[int, typer.Option(min=9, max=999, help="The template's width and height in pixels.")] = 49,
) -> None:
    """Print the camera's mount as a flight past a landmark or scenery shows it, ready to paste into the config."""
    from service.recordings.flights import newest_flight
    from service.recordings.recording import Recording

    if time_offset and landmark is None:
        raise typer.BadParameter("--time-offset needs a --landmark")
    if (cut_template is None) is not (at is None):
        raise typer.BadParameter("--cut-template and --at need each other")
    recording = newest_flight(recording, lambda line: say(line, err=True))
    if cut_template is not None and at is not None:
        from service.commands.calibrate import cut_template as cutting

        cutting.cut_template(Recording(recording), config, cut_template, at, frame, side, landmark, say)
        return
    from service.commands.calibrate.calibrate import run_calibrate
    from service.commands.progress import log_progress

    with log_progress(recording.name) as on_progress:
        run_calibrate(Recording(recording), config, landmark, segmenter, time_offset, say, on_progress)
