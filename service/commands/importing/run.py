"""What `distloc import` does: read, join, complete, tie the clocks, write, and say what came of it."""

import contextlib
import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from distloc.backports import tomllib
from service.commands.importing import words
from service.config.load import load_config
from service.config.sections import CameraConfig, Config
from service.recordings.importers.assumptions import Assumed, completed
from service.recordings.importers.clock_tie import sway_deg, tie_clocks
from service.recordings.importers.flight import Film, Given, ImportedFlight, ImportRefusedError, Lens, Stills
from service.recordings.importers.join import check_overlap, joined, released, shifted_by, time_span
from service.recordings.importers.output.config_text import HEADING_DEG, TILT_DEG, Mount, config_text
from service.recordings.importers.output.resampling import resampled_attitudes, resampled_positions
from service.recordings.importers.output.sightings_table import write_sightings
from service.recordings.importers.output.writing import whole_folder, write_recording
from service.recordings.importers.readers import read_sources
from service.recordings.recording import Recording


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the command line asks for; degrees, seconds, hours and metres."""

    out: Path | None = None
    attitude: Path | None = None
    config: Path | None = None
    mount_deg: tuple[float, float, float] | None = None
    mount_sigma_deg: float | None = None
    hfov_deg: float | None = None
    by_course: bool = False
    time_offset_s: float | None = None
    utc_offset_h: float | None = None
    geoid_m: float | None = None
    home_alt_m: float | None = None
    sightings: Path | None = None


def run_import(sources: list[Path], wanted: Wanted, say: Callable[[str], None]) -> None:
    """Write the recording and print the table; ImportRefusedError or ConfigError, one line, where that cannot be."""
    if wanted.out is None and wanted.sightings is None:
        raise ImportRefusedError("nothing to write: give --out RECORDING, or --sightings FILE")
    given_text, given = _given_config(wanted.config)
    mount = Mount(*(wanted.mount_deg or (0.0, 0.0, 0.0)), sigma_deg=wanted.mount_sigma_deg)
    has_mount = wanted.mount_deg is not None or "mount" in given.get("camera", {})
    rows = None
    with _scratch_folder() if wanted.out is None else whole_folder(wanted.out) as folder:
        flight = _read(sources, wanted)
        if flight.needs_mount and not (has_mount and (wanted.mount_sigma_deg or "mount" in given.get("camera", {}))):
            raise ImportRefusedError(
                f"{flight.source}: tells the craft's attitude, not its camera's: give --attitude FILE, or --mount YAW "
                "PITCH ROLL and --mount-sigma DEGREES by what the pictures show; the scenery then measures it"
            )
        flight = completed(flight, Assumed(wanted.by_course, wanted.geoid_m, wanted.home_alt_m))
        time_span(flight)
        flight = _with_lens(flight, wanted, given)
        flight, text_of = _resampled(flight, mount, given_text, given)
        config = _put_config(folder, text_of(flight))
        flight, clock_sigma_s = _tied(flight, wanted, config.camera)
        _put_config(folder, text_of(flight))  # how well it is tied is in the errors
        check_overlap(flight)
        if wanted.sightings is not None:
            rows = write_sightings(wanted.sightings, flight, mount)
        if wanted.out is not None:
            write_recording(folder, flight, clock_sigma_s)
            Recording(folder)
    for line in words.table(flight, wanted.out, wanted.sightings, rows):
        say(line)


@contextlib.contextmanager
def _scratch_folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def _read(sources: list[Path], wanted: Wanted) -> ImportedFlight:
    utc_offset_s = None if wanted.utc_offset_h is None else wanted.utc_offset_h * 3600.0
    given = Given(utc_offset_s=utc_offset_s, by_course=wanted.by_course)
    parts = read_sources(sources, given)
    if wanted.attitude is not None:
        parts = [
            *_attitudes(wanted.attitude, given, parts),
            *(replace(one, craft=None, camera=None, gimbal=None) for one in parts),
        ]
    return joined(parts)


def _attitudes(path: Path, given: Given, parts: list[ImportedFlight]) -> list[ImportedFlight]:
    """What --attitude tells; times without a date, or frames' numbers, count from the start of a film that is tied."""
    tied = [(one, one.frames) for one in parts if isinstance(one.frames, Film) and one.frames_tied]
    found = [
        replace(one, positions=None, fixes=None, estimates=None, home=None, lens=None, frames=None)
        for one in read_sources([path], replace(given, films=tuple(film.path for _, film in tied)))
    ]
    if not any(one.craft or one.camera or one.gimbal for one in found):
        raise ImportRefusedError(f"--attitude {path}: tells no attitude")
    if len(tied) == 1 and tied[0][0].epoch_s is not None:
        for one in found:
            if one.epoch_s is None:
                one.remarks.assumed.append(f"its times count from the start of {tied[0][1].path.name}")
        found = [one if one.epoch_s is not None else replace(one, epoch_s=tied[0][0].epoch_s) for one in found]
    return found


def _given_config(path: Path | None) -> tuple[str, dict[str, Any]]:
    """The user's config as text and as TOML, once it was found to be one."""
    if path is None:
        return "", {}
    load_config(path)
    text = path.read_text(encoding="utf-8-sig")
    return text, tomllib.loads(text)


def _with_lens(flight: ImportedFlight, wanted: Wanted, given: dict[str, Any]) -> ImportedFlight:
    """ImportRefusedError where there are frames and nobody tells their lens: a guess would be confidently wrong."""
    lens = flight.lens
    if flight.frames is None or "camera" in given:
        return flight
    if lens is None:
        raise ImportRefusedError(f"{flight.source}: has frames of unknown size")
    if wanted.hfov_deg is not None:
        return replace(flight, lens=Lens(lens.width, lens.height, hfov_deg=wanted.hfov_deg))
    if lens.fx is None and lens.hfov_deg is None:
        raise ImportRefusedError(
            f"{flight.source}: does not tell its lens: give --hfov DEGREES, or --config FILE with a [camera]"
        )
    return flight


def _tied(flight: ImportedFlight, wanted: Wanted, camera: CameraConfig) -> tuple[ImportedFlight, float | None]:
    """The frames on the poses' clock, and how sure that is, one standard deviation; None where nobody knows."""
    frames, tied_sigma_s = flight.frames, 0.0 if flight.frames_tied else None
    if isinstance(frames, Stills) and not flight.frames_tied:
        flight = released(flight)  # by releases of the shutter, which come some time before the picture
        frames = flight.frames
    if frames is None:
        return flight, 0.0
    if wanted.time_offset_s is not None:
        is_near = flight.frames_tied or flight.tied_within_s is not None
        first_s = 0.0 if is_near else time_span(flight)[0] - float(frames.time_s[0])
        flight.remarks.assumed.append(f"frames are {wanted.time_offset_s:+.3f} s later, as --time-offset says")
        return replace(shifted_by(flight, first_s + wanted.time_offset_s, ("frames",)), frames_tied=True), None
    if flight.frames_tied:
        return flight, tied_sigma_s
    try:
        tie = tie_clocks(flight, camera)
    except ImportRefusedError:
        if flight.tied_within_s is None:
            raise
        return _nearly_tied(flight, camera, "does not tell"), None
    if flight.tied_within_s is not None and abs(tie.offset_s) > flight.tied_within_s + 3.0 * tie.sigma_s:
        return _nearly_tied(flight, camera, f"says {tie.offset_s:+.2f} s, which cannot be"), None
    first_s = float(frames.time_s[0]) + tie.offset_s - time_span(flight)[0]
    flight.remarks.found.append(
        f"clock: the first frame {first_s:+.3f} s after the first pose, sigma {tie.sigma_s * 1e3:.0f} ms, by the "
        f"turning in {tie.pairs} pairs of frames"
    )
    return replace(shifted_by(flight, tie.offset_s, ("frames",)), frames_tied=True), tie.sigma_s


def _nearly_tied(flight: ImportedFlight, camera: CameraConfig, why: str) -> ImportedFlight:
    """As the source has them, with the attitude as unsure as the camera turns in that time."""
    assert flight.tied_within_s is not None
    sway = sway_deg(flight, camera, flight.tied_within_s)
    yaw_deg = HEADING_DEG if flight.yaw_sigma_deg is None else flight.yaw_sigma_deg
    tilt_deg = TILT_DEG if flight.tilt_sigma_deg is None else flight.tilt_sigma_deg
    flight.remarks.assumed.append(
        f"frames and poses are on one clock within {flight.tied_within_s:.1f} s, for the camera's turning {why}: "
        f"attitudes are taken as less sure by the {sway:.2f} deg that it turns in that time"
    )
    return replace(flight, yaw_sigma_deg=math.hypot(yaw_deg, sway), tilt_sigma_deg=math.hypot(tilt_deg, sway))


def _resampled(
    flight: ImportedFlight, mount: Mount, given_text: str, given: dict[str, Any]
) -> tuple[ImportedFlight, Callable[[ImportedFlight], str]]:
    """The poses at the rates that a replay needs, and what makes the config that says how sure they are then."""
    assert flight.craft is not None and flight.positions is not None
    craft, of_craft = resampled_attitudes(flight.craft)
    positions, of_positions = resampled_positions(flight.positions)
    gimbal, of_camera = flight.gimbal, of_craft
    if gimbal is not None:
        attitudes, of_camera = resampled_attitudes(gimbal.attitudes)
        gimbal = replace(gimbal, attitudes=attitudes)
    flight = replace(flight, craft=craft, gimbal=gimbal, positions=positions)
    if isinstance(flight.frames, Stills) and np.isin(flight.frames.time_s, craft.time_s).all():
        of_camera = replace(of_camera, gaps=0)  # each picture has its own
    words.note_resampled(flight.remarks, of_camera, of_positions, "pose_errors" in given)
    return flight, lambda tied: config_text(tied, mount, of_camera, of_positions, given_text, given)


def _put_config(folder: Path, text: str) -> Config:
    (folder / "config.toml").write_text(text, encoding="utf-8")
    return load_config(folder / "config.toml")
