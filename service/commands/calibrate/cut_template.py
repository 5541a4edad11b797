"""Cuts a landmark's template from a recorded frame; `calibrate --cut-template` calls it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from service.commands.errors import OutputError
from service.common.files import write_whole
from service.config.explained import explained
from service.config.landmarks import check_template
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
    cannot be found again; OutputError where it can't be written, or the config would refuse the lines. `out` then
    stays what it was.
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
    corner_px = np.rint(at_px) - side_px // 2
    if not ((corner_px >= 0) & (corner_px <= np.array([width, height]) - side_px)).all():  # nor where it is no number
        raise RecordingError(
            f"{folder}: {side_px} x {side_px} pixels about {at_px[0]:g} {at_px[1]:g} reach out of the frame of "
            f"{width} x {height}: take another --at, or a smaller --side"
        )
    left, top = corner_px.astype(int)
    png = _checked(image[top : top + side_px, left : left + side_px], out, width, height)
    lines = [] if landmark is None else _lines(out, landmark)
    try:
        write_whole(out, png)
    except OSError as error:
        raise OutputError(
            f"--cut-template {out}: must be a file in a folder that can be written: {error.strerror}"
        ) from error
    for line in (f"# wrote {out}: {side_px} x {side_px} pixels of frame {frame} ({frames[frame][1]})", *lines):
        echo(line)


def _checked(cut: NDArray[np.uint8], out: Path, width: int, height: int) -> bytes:
    """The piece as PNG, which can be found again in frames of a size as the config reads it."""
    png = cv2.imencode(".png", cut)[1]
    grey = np.asarray(cv2.imdecode(png, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
    try:
        check_template(f"the piece that was cut, for '{out}'", grey, width, height)
    except ConfigError as error:
        raise RecordingError(str(error)) from error
    return png.tobytes()


def _lines(out: Path, landmark: tuple[float, float, float]) -> list[str]:
    """The config's lines for the template, which it will take."""
    lat, lon, alt_m = landmark
    values: dict[str, Any] = {"name": out.stem, "lat": lat, "lon": lon, "alt_m": alt_m, "template": out.name}
    content = {"landmarks": [values]}
    try:
        msgspec.convert(content, Config)
    except msgspec.ValidationError as error:
        raise OutputError(
            f"--cut-template {out} with that --landmark: the config refuses {explained(error, content, Config)}"
        ) from error
    return ["[[landmarks]]", *(f"{key} = {msgspec.json.encode(value).decode()}" for key, value in values.items())]
