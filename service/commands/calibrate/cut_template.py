"""Cuts a landmark's template from a recorded frame; `calibrate --cut-template` calls it."""

from collections.abc import Callable
from pathlib import Path

import cv2

from service.common.files import write_whole
from service.config.landmarks import LandmarkConfig, read_template
from service.config.load import load_config
from service.config.section import ConfigError
from service.config.sections import Config
from service.recordings.recording import Recording, RecordingError


def cut_template(
    recording: Recording,
    config_path: Path | None,
    out: Path,
    at_px: tuple[float, float],
    frame: int,
    side_px: int,
    landmark: tuple[float, float, float] | None,
    echo: Callable[[str], None],
) -> None:
    """Write the square of a frame about a pixel as PNG, and say the lines of the config for it where it stands.

    `frame` counts from 0 in order of time. RecordingError where there is no such frame or piece of it, or one that
    cannot be found again.
    """
    path, folder = config_path or recording.config_path, recording.tlog_path.parent
    config = load_config(path) if path else Config()
    frames = recording.frames()
    if not frame < len(frames):
        raise RecordingError(f"{folder}: --frame is {frame}: there are {len(frames)}, 0 is the first")
    image = recording.load_image(frames[frame][1])
    if image is None:
        raise RecordingError(f"{folder}: frame {frame} has no picture ({frames[frame][1]}): take another --frame")
    width, height = config.camera.width, config.camera.height
    if image.shape[:2] != (height, width):
        raise RecordingError(
            f"{folder}: frame {frame} is {image.shape[1]} x {image.shape[0]} pixels, the camera {width} x {height}: a "
            "template is cut at the full size"
        )
    left, top = (round(middle) - side_px // 2 for middle in at_px)
    if not (0 <= left <= width - side_px and 0 <= top <= height - side_px):
        raise RecordingError(
            f"{folder}: {side_px} x {side_px} pixels about {at_px[0]:g} {at_px[1]:g} reach out of the frame of "
            f"{width} x {height}: take another --at, or a smaller --side"
        )
    cut = image[top : top + side_px, left : left + side_px]
    write_whole(out, cv2.imencode(".png", cut)[1].tobytes())
    lat, lon, alt_m = landmark or (0.0, 0.0, 0.0)
    try:
        one = LandmarkConfig(name="cut", lat=lat, lon=lon, alt_m=alt_m, template=str(out))
        read_template(0, one, width, height)
    except ConfigError as error:
        out.unlink()
        raise RecordingError(str(error).replace("landmarks[0].template is", "the piece that was cut,")) from error
    echo(f"# wrote {out}: {side_px} x {side_px} pixels of frame {frame} ({frames[frame][1]})")
    if landmark is not None:
        for line in ("[[landmarks]]", f'name = "{out.stem}"', f"lat = {lat}", f"lon = {lon}", f"alt_m = {alt_m}"):
            echo(line)
        echo(f'template = "{out.name}"')
