"""Ties the frames' clock to the poses' by the camera's turning, where no source says how they belong together.

The same turning and the same estimate as `calibrate --time-offset` has; `distloc import` calls it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.calibration.clock_search import chained, rates_on_grid, search_clock
from distloc.calibration.image_turns import TurnMeter
from distloc.calibration.pose_trail import PoseTrail
from distloc.calibration.time_offset import LEAST_USED, estimate_time_offset, turn_residuals, vee
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, heading_rad, matrix_from_euler, matrix_from_quaternion
from distloc.types import CameraPose, FloatArray
from service.common.files import FileRefusedError, read_picture
from service.config.sections import CameraConfig
from service.recordings.importers.flight import Attitudes, Film, ImportedFlight, ImportRefusedError, Stills
from service.recordings.importers.output.resampling import interpolated

_PAIR_S = 0.09  # frames a tenth of a second apart tell the turning; more are only slower
_LONGEST_PAIR_S = 1.0
_MOST_PAIRS = 6000  # ten minutes of film
_MOST_POSES_S = 6 * 3600.0
_STEP_S = 0.02
_SPAN_S = 0.5  # over which turns are compared: longer than corners err, shorter than a craft rocks
_ANY_SWAY_DEG = 20.0
_GAP_S = 0.3  # between attitudes; over longer ones nothing is known
_COMMON_S = 0.005  # an exposure's middle, a shutter that rolls, logs that stamp late: seen were 3.5 ms
_HELP = "give --time-offset SECONDS, from the first pose to the first frame"


@dataclass(frozen=True, slots=True)
class Tie:
    """`offset_s`: added to the frames' times it gives the poses'; its one standard deviation; pairs of frames used.

    The turning is silent about what all frames or all poses share; the standard deviation allows for that.
    """

    offset_s: float
    sigma_s: float
    pairs: int


def tie_clocks(flight: ImportedFlight, camera: CameraConfig) -> Tie:
    """The frames' offset. Raises ImportRefusedError where the turning does not tell it: one is never guessed."""
    assert flight.frames is not None and flight.craft is not None
    where = f"{flight.source}: the frames' clock is tied to nothing"
    starts_s, ends_s, turns_rad = _turns(flight.frames, camera.camera(), where)
    if len(ends_s) < LEAST_USED:
        raise ImportRefusedError(
            f"{where}, and of its frames only {len(ends_s)} pairs, close in time, show the scenery's corners: {_HELP}"
        )
    trail, trail_s = _trail(flight, camera)
    found = search_clock(rates_on_grid(starts_s, ends_s, turns_rad, _LONGEST_PAIR_S), _rates(trail, trail_s))
    if found is None or not found.is_clear:
        like = "too short to search" if found is None else f"best {found.like:.2f}, elsewhere {found.next_like:.2f}"
        raise ImportRefusedError(
            f"{where}, and the camera's turning in the frames is not found in the attitudes ({like}, of 1): are "
            f"--mount and lens right, does the craft rock? else {_HELP}"
        )
    moved = (starts_s + found.offset_s, ends_s + found.offset_s)
    fine = estimate_time_offset(turn_residuals(trail, *moved, turns_rad), moved[1])
    if fine.offset_s is None:
        raise ImportRefusedError(f"{where}, and the turning tells it to no better than {fine.sigma_s:.3f} s: {_HELP}")
    return Tie(found.offset_s - fine.offset_s, math.hypot(fine.sigma_s, _COMMON_S), fine.used)


def sway_deg(flight: ImportedFlight, camera: CameraConfig, within_s: float) -> float:
    """By how much the camera turns within a time, rms, about the axis about which that is most: what a clock that is
    off by that much costs. Of a flight whose attitudes are too few to tell it is that of any.
    """
    try:
        trail, times_s = _trail(flight, camera)
    except ImportRefusedError:
        return _ANY_SWAY_DEG
    R_start, _, is_start = trail.at(times_s)
    R_end, _, is_end = trail.at(times_s + within_s)
    turns_rad = vee(R_end @ np.swapaxes(R_start, 1, 2))[is_start & is_end]
    return float(np.degrees(np.sqrt(np.mean(turns_rad**2, axis=0)).max())) if len(turns_rad) else _ANY_SWAY_DEG


def _turns(frames: Film | Stills, camera: Camera, where: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Start, end (n,) and turn (n, 3) of the camera over half a second, in its axes."""
    meter, before_s = TurnMeter(camera), -np.inf
    rows: list[tuple[float, float, FloatArray]] = []
    for time_s, image in _images(frames):
        if image.shape[:2] != (camera.height, camera.width):
            size = f"{image.shape[1]} x {image.shape[0]}"
            raise ImportRefusedError(
                f"{where}: its frames are {size}, the camera {camera.width} x {camera.height}: they must be alike"
            )
        if time_s - before_s > _LONGEST_PAIR_S:
            meter.forget()
        R = meter.turn(image, None, None)
        if R is not None:
            rows.append((before_s, time_s, R))
        before_s = time_s
        if len(rows) >= _MOST_PAIRS:
            break
    starts_s, ends_s = (np.array([row[i] for row in rows]) for i in (0, 1))
    starts_s, ends_s, turns = chained(starts_s, ends_s, np.array([row[2] for row in rows]), _SPAN_S)
    return starts_s, ends_s, vee(turns)


def _images(frames: Film | Stills) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    if isinstance(frames, Film):
        yield from _film_images(frames.path, frames.time_s)
        return
    for time_s, path in sorted(zip(frames.time_s.tolist(), frames.paths, strict=True)):
        try:
            yield time_s, read_picture(path).image
        except FileRefusedError:
            continue


def _film_images(path: Path, times_s: FloatArray) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    capture, last_s = cv2.VideoCapture(str(path)), -np.inf
    try:
        for time_s in times_s.tolist():
            if not capture.grab():
                return
            if time_s - last_s < _PAIR_S:
                continue
            ok, image = capture.retrieve()
            if ok:
                last_s = time_s
                yield time_s, np.asarray(image, dtype=np.uint8)
    finally:
        capture.release()


def _trail(flight: ImportedFlight, camera: CameraConfig) -> tuple[PoseTrail, FloatArray]:
    """The camera's attitude every `_STEP_S` where it is known, on the poses' clock."""
    assert flight.craft is not None
    craft, mount = flight.craft, camera.mount.R_body_from_mount
    last_s = min(craft.time_s[-1], craft.time_s[0] + _MOST_POSES_S)
    times_s = np.arange(craft.time_s[0], last_s, _STEP_S)
    times_s = times_s[_is_known(craft, times_s)]
    q = interpolated(craft.time_s, craft.q_ned_from_body, times_s)
    bases = [matrix_from_quaternion(one) for one in q]
    if flight.gimbal is not None and camera.mount.gimbal:
        gimbal = flight.gimbal.attitudes
        is_known = _is_known(gimbal, times_s)
        q = interpolated(gimbal.time_s, gimbal.q_ned_from_body, times_s)
        is_earth = flight.gimbal.yaw_from == "earth"
        bases = [
            matrix_from_quaternion(one)
            if is_earth
            else matrix_from_euler(heading_rad(R), 0.0, 0.0) @ matrix_from_quaternion(one)
            for R, one in zip(bases, q, strict=True)
        ]
        bases = [R for R, is_there in zip(bases, is_known, strict=True) if is_there]
        times_s = times_s[is_known]
    if len(times_s) < 2:
        raise ImportRefusedError(f"{flight.source}: too few attitudes to tie the frames' clock to: {_HELP}")
    poses = [
        CameraPose(float(time_s), np.zeros(3), R_cam_from_enu(R, mount))
        for time_s, R in zip(times_s, bases, strict=True)
    ]
    return PoseTrail(poses), times_s


def _is_known(attitudes: Attitudes, times_s: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    after = np.clip(np.searchsorted(attitudes.time_s, times_s), 1, max(1, len(attitudes.time_s) - 1))
    if len(attitudes.time_s) < 2:
        return np.zeros(len(times_s), dtype=bool)
    return np.asarray(attitudes.time_s[after] - attitudes.time_s[after - 1] <= _GAP_S)


def _rates(
    trail: PoseTrail, times_s: FloatArray
) -> tuple[float, FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    starts_s = times_s[::5]
    ends_s = starts_s + _SPAN_S
    R_start, _, is_start = trail.at(starts_s)
    R_end, _, is_end = trail.at(ends_s)
    good = is_start & is_end
    return rates_on_grid(starts_s[good], ends_s[good], vee(R_end @ np.swapaxes(R_start, 1, 2))[good], _GAP_S)
