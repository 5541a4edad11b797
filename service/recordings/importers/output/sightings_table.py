"""A table for `distloc locate` with a row for each picture, in which an analyst marks where the smoke is."""

import csv
import math
from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np

from distloc.geometry.rotations import euler_from_matrix, heading_rad, matrix_from_euler, matrix_from_quaternion
from distloc.types import FloatArray
from service.recordings.importers.flight import Film, ImportedFlight, ImportRefusedError
from service.recordings.importers.output.config_text import Mount
from service.recordings.importers.output.resampling import MOST_FILLED_S, interpolated

_HEADER = (
    *("picture", "time", "platform", "lat", "lon", "alt_msl_m", "yaw_deg", "pitch_deg", "roll_deg", "heading_deg"),
    *("width", "height", "hfov_deg", "heading_bias_deg", "tilt_bias_deg", "u_px", "v_px", "target"),
)
_FRAME_STEP_S = 1.0  # a film's pictures of every second tell nearly all that those of every frame do
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)
_USUAL_SIGMAS_DEG = (2.0, 0.5)  # of a consumer's drone


def write_sightings(path: Path, flight: ImportedFlight, mount: Mount) -> int:
    """How many rows were written to a new file; ImportRefusedError where there are no pictures, lens or poses for them.

    `u_px`, `v_px` and `target` are empty: a row in which nobody marks a pixel is no sighting.
    """
    lens = flight.lens
    if flight.frames is None or lens is None or (lens.fx is None and lens.hfov_deg is None):
        raise ImportRefusedError(f"--sightings {path}: needs pictures and their lens: {flight.source} lacks them")
    rows = list(_rows(flight, mount))
    if not rows:
        raise ImportRefusedError(f"--sightings {path}: no picture of {flight.source} has a pose")
    try:
        with path.open("x", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(_HEADER)
            writer.writerows(rows)
    except FileExistsError as error:
        raise ImportRefusedError(f"--sightings {path}: exists already: give another name, or remove it") from error
    except OSError as error:
        raise ImportRefusedError(f"--sightings {path}: cannot be written: {error.strerror}") from error
    return len(rows)


def _rows(flight: ImportedFlight, mount: Mount) -> Iterator[list[object]]:
    frames, positions, lens = flight.frames, flight.positions, flight.lens
    attitudes = flight.craft if flight.gimbal is None else flight.gimbal.attitudes
    assert frames is not None and positions is not None and attitudes is not None and lens is not None
    if lens.hfov_deg is not None:
        hfov_deg = lens.hfov_deg
    else:
        assert lens.fx is not None
        hfov_deg = math.degrees(2.0 * math.atan(lens.width / 2.0 / lens.fx))
    chosen = _chosen(flight)
    at_s = frames.time_s[chosen]
    q = interpolated(attitudes.time_s, attitudes.q_ned_from_body, at_s)
    nose_q = interpolated(flight.craft.time_s, flight.craft.q_ned_from_body, at_s) if flight.craft else q
    lat, lon, alt = (
        np.interp(at_s, positions.time_s, one)
        for one in (positions.lat_deg, np.unwrap(positions.lon_deg, period=360.0), positions.alt_msl_m)
    )
    R_body_from_camera = matrix_from_euler(*np.radians([mount.yaw_deg, mount.pitch_deg, mount.roll_deg]))
    told = (flight.yaw_sigma_deg, flight.tilt_sigma_deg)
    sigmas_deg = [
        math.hypot(usual if one is None else one, mount.sigma_deg or 0.0)
        for one, usual in zip(told, _USUAL_SIGMAS_DEG, strict=True)
    ]
    for row, number in enumerate(chosen):
        angles_deg = np.degrees(euler_from_matrix(matrix_from_quaternion(q[row]) @ R_body_from_camera))
        name = str(number) if isinstance(frames, Film) else frames.paths[number].name
        yield [
            *(name, _time(flight, float(at_s[row])), flight.source),
            *(f"{lat[row]:.8f}", f"{(lon[row] + 180.0) % 360.0 - 180.0:.8f}", f"{alt[row]:.3f}"),
            *(f"{one:.4f}" for one in angles_deg),
            "" if flight.gimbal is None else f"{math.degrees(heading_rad(matrix_from_quaternion(nose_q[row]))):.3f}",
            *(lens.width, lens.height, f"{hfov_deg:.4f}", *(f"{one:.3f}" for one in sigmas_deg), "", "", ""),
        ]


def has_pose(flight: ImportedFlight) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which frames (N,) lie between places and attitudes that are close enough."""
    frames, positions, craft = flight.frames, flight.positions, flight.craft
    assert frames is not None and positions is not None and craft is not None
    is_near = _is_near(positions.time_s, frames.time_s, MOST_FILLED_S["position"])
    for attitudes in (craft, craft if flight.gimbal is None else flight.gimbal.attitudes):
        is_near &= _is_near(attitudes.time_s, frames.time_s, MOST_FILLED_S["attitude"])
    return is_near


def _chosen(flight: ImportedFlight) -> list[int]:
    """Frames with a pose near; of a film those that count, about one a second."""
    frames, is_near = flight.frames, has_pose(flight)
    assert frames is not None
    if isinstance(frames, Film):
        if frames.is_used is not None:
            is_near &= frames.is_used
        step = np.floor(frames.time_s / _FRAME_STEP_S)
        is_near &= np.diff(step, prepend=-np.inf) > 0
    return [int(one) for one in np.flatnonzero(is_near)]


def _is_near(pose_s: FloatArray, at_s: FloatArray, gap_s: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether each time is a pose's, or lies between two that are no further apart than `gap_s`."""
    after = np.clip(np.searchsorted(pose_s, at_s), 0, len(pose_s) - 1)
    before = np.clip(after - 1, 0, None)
    is_inside = (pose_s[before] <= at_s) & (at_s <= pose_s[after]) & (pose_s[after] - pose_s[before] <= gap_s)
    return np.asarray(is_inside | (pose_s[after] == at_s))


def _time(flight: ImportedFlight, time_s: float) -> str:
    if flight.epoch_s is None:
        return f"{time_s:.3f}"
    moment = _EPOCH + timedelta(seconds=flight.epoch_s + time_s)
    return moment.strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z"
