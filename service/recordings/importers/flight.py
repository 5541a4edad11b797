"""What every importer gives: a flight as its source tells it, before anything is assumed. Free of I/O."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from distloc.types import BoolArray, FloatArray

IntArray = NDArray[np.int64]


class ImportRefusedError(Exception):
    """The source cannot be used: one line that names the file, what is wrong with it and what would be right."""


@dataclass(frozen=True)
class Attitudes:
    """Of a craft, a gimbal or a camera, in rising time: `time_s` (N,), on the clock that the flight's `epoch_s` is of.

    `q_ned_from_body` (N, 4), unit, w first: forward, right, down to north, east, down. `rate_rps` (N, 3) about the
    body's axes, NaN where it is not told.
    """

    time_s: FloatArray
    q_ned_from_body: FloatArray
    rate_rps: FloatArray


@dataclass(frozen=True)
class Positions:
    """In rising time: `time_s` (N,), `lat_deg` and `lon_deg` (N,) WGS 84. NaN in what follows: not told.

    `alt_msl_m`, `alt_ellipsoid_m` and `above_home_m` (N,); `velocity_ned_mps` (N, 3).
    """

    time_s: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    alt_msl_m: FloatArray
    alt_ellipsoid_m: FloatArray
    above_home_m: FloatArray
    velocity_ned_mps: FloatArray


@dataclass(frozen=True)
class Fixes:
    """The receiver's own word, in rising time: `time_s` (N,), `fix_type` (N,) as in MAVLink's GPS_FIX_TYPE,

    `satellites` (N,), 255 where not told, `h_acc_m` and `v_acc_m` (N,) one standard deviation, NaN where not told.
    """

    time_s: FloatArray
    fix_type: IntArray
    satellites: IntArray
    h_acc_m: FloatArray
    v_acc_m: FloatArray


@dataclass(frozen=True)
class Estimates:
    """The estimator's own word, in rising time: `time_s` (N,), `flags` (N,) as in MAVLink's EKF_STATUS_FLAGS,

    and innovation test ratios (N,), 1 is rejected, NaN where not told.
    """

    time_s: FloatArray
    flags: IntArray
    velocity_ratio: FloatArray
    position_ratio: FloatArray
    height_ratio: FloatArray
    compass_ratio: FloatArray


@dataclass(frozen=True)
class Gimbal:
    """A gimbal's attitudes: from north ("earth") or from the craft's nose ("vehicle"), as q in `attitudes` then is."""

    attitudes: Attitudes
    yaw_from: Literal["earth", "vehicle"]


@dataclass(frozen=True)
class Lens:
    """Of the pictures at the size that they have; None where the source does not tell."""

    width: int
    height: int
    fx: float | None = None
    hfov_deg: float | None = None


@dataclass(frozen=True)
class Film:
    """One film; frame i was taken at `time_s[i]` (N,), on the clock that `is_tied` names.

    `is_used` (N,) leaves frames out that were taken through another lens; None: all count.
    """

    path: Path
    time_s: FloatArray
    is_used: BoolArray | None = None


@dataclass(frozen=True)
class Stills:
    """Pictures of their own, `paths[i]` taken at `time_s[i]` (N,)."""

    paths: Sequence[Path]
    time_s: FloatArray


@dataclass(frozen=True)
class Given:
    """What a reader is told beside its own file: films and pictures named with it, and the zone of times without one.

    A reader that returns one of `films` as its frames has taken it; those that none takes are read by themselves.
    `utc_offset_s` is local time minus UTC, None where the user said nothing. `by_course`: the user allows that what
    knows no north looks along the course.
    """

    films: tuple[Path, ...] = ()
    utc_offset_s: float | None = None
    stills: tuple[Path, ...] = ()
    by_course: bool = False


@dataclass(frozen=True)
class Remarks:
    """Lines for the user's table, and counted bad rows by reason.

    What was found, what lacks, what was assumed; `doubt`: what contradicts itself, so that the user must look.
    """

    found: list[str] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    doubt: list[str] = field(default_factory=list)
    dropped: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class ImportedFlight:
    """A flight, or the part of one that a source knows.

    `epoch_s` is the UNIX time of `time_s` 0, None where no date is known. `camera` is the camera's own attitude from
    north where the source tells that one alone (a DJI's gimbal); `craft` the vehicle's. `frames_tied` says whether the
    frames' times are on the same clock as the poses'; if not, they are tied by the frames' turning, or, of stills, by
    `triggers_s` (M,), when the camera was released. `tied_within_s`: they are on that clock, but for so much: turning
    is looked for within it; where it does not tell they stay as they are, and the replay keeps its doubt of the clock.
    `position_step_m`: places are written in such steps, None where the digits themselves tell it.
    `home` is latitude and longitude in degrees and altitude above mean sea level in metres. `needs_mount`: the craft's
    attitude is told of a camera that its pilot turned, so the user must say where it looked.
    """

    source: str
    epoch_s: float | None
    positions: Positions | None = None
    craft: Attitudes | None = None
    gimbal: Gimbal | None = None
    camera: Attitudes | None = None
    fixes: Fixes | None = None
    estimates: Estimates | None = None
    home: tuple[float, float, float] | None = None
    lens: Lens | None = None
    frames: Film | Stills | None = None
    frames_tied: bool = True
    tied_within_s: float | None = None
    triggers_s: FloatArray | None = None
    yaw_sigma_deg: float | None = None
    tilt_sigma_deg: float | None = None
    position_step_m: float | None = None
    needs_mount: bool = False
    remarks: Remarks = field(default_factory=Remarks)


def unknown(count: int, width: int | None = None) -> FloatArray:
    """(count,) or (count, width) of NaN: not told."""
    return np.full(count if width is None else (count, width), np.nan)
