"""The camera's and the craft's attitudes of the cues, from north."""

from collections.abc import Sequence

import numpy as np

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import FloatArray
from service.recordings.importers.dji.words import Words
from service.recordings.importers.flight import Remarks
from service.recordings.importers.rows import count

_MOST_DEG = 360.0
_UPSIDE_DOWN_DEG = 30.0  # a roll so near 180 is a gimbal's flip, not a bank
_LEAST_ZEROS = 2
_NADIR_DEG = 80.0  # nearer to straight down a roll of 180 and a yaw that turned cancel out


def camera_angles_deg(rows: Sequence[Words], remarks: Remarks) -> FloatArray:
    """Yaw, pitch, roll (N, 3) of the gimbal's camera from north and the horizon, NaN where it is not told."""
    angles = _of_keys(rows, "gb")
    if not np.isfinite(angles).all(axis=1).any():
        angles = _of_function(rows, "G.PRY", remarks)
    return upright(not_all_zero(angles, remarks), remarks)


def craft_angles_deg(rows: Sequence[Words], remarks: Remarks) -> FloatArray:
    """Yaw, pitch, roll (N, 3) of the craft's body, NaN where it is not told."""
    angles = not_all_zero(_of_keys(rows, "drone"), remarks, "craft")
    return angles if np.isfinite(angles[:, 0]).any() else _of_function(rows, "F.PRY", remarks)


def upright(angles_deg: FloatArray, remarks: Remarks) -> FloatArray:
    """The same with the flip of a gimbal that hangs, or stands, the other way round taken out: pictures are upright."""
    yaw, pitch, roll = angles_deg.T
    is_flipped = (np.abs(np.abs(roll) - 180.0) < _UPSIDE_DOWN_DEG) & (np.abs(pitch) < _NADIR_DEG)
    if is_flipped.any():
        remarks.assumed.append("a gimbal's roll of 180 degrees turns no picture: the camera stores them upright")
    return np.stack([yaw, pitch, np.where(is_flipped, roll - np.copysign(180.0, roll), roll)], axis=1)


def not_all_zero(angles_deg: FloatArray, remarks: Remarks, name: str = "gimbal") -> FloatArray:
    """The same, NaN where yaw, pitch and roll (N, 3) are 0 in every row: a field that nobody fills, not a camera."""
    is_told = np.isfinite(angles_deg).all(axis=1)
    if is_told.sum() < _LEAST_ZEROS or angles_deg[is_told].any():
        return angles_deg
    count(remarks, f"{name}: angles of 0, 0, 0 all along: they are not told", int(is_told.sum()))
    return np.full_like(angles_deg, np.nan)


def quaternions(angles_deg: FloatArray) -> FloatArray:
    """(N, 4) of yaw, pitch, roll (N, 3); NaN where an angle is."""
    return np.array([quaternion_from_euler(*np.radians(one)) for one in angles_deg]).reshape(-1, 4)


def _of_keys(rows: Sequence[Words], stem: str) -> FloatArray:
    found = np.array([[one.number(f"{stem}_{name}") for name in ("yaw", "pitch", "roll")] for one in rows])
    found = found.reshape(-1, 3)
    return np.where((np.abs(found) <= _MOST_DEG).all(axis=1, keepdims=True), found, np.nan)


def _of_function(rows: Sequence[Words], name: str, remarks: Remarks) -> FloatArray:
    """Of (pitch, roll, yaw): degrees where they have a point or the sign, else tenths where they pass a circle."""
    told = [one.functions.get(name) for one in rows]
    found = np.array([one.values if one and len(one.values) == 3 else (np.nan,) * 3 for one in told]).reshape(-1, 3)
    is_exact = any("°" in "".join(one.units) or "." in "".join(one.texts) for one in told if one)
    if not np.isfinite(found).any():
        return found[:, [2, 0, 1]]
    if not is_exact:
        if np.nanmax(np.abs(found)) <= _MOST_DEG:
            remarks.lacks.append(f"{name}: whole numbers without a sign are degrees or tenths of them: not used")
            return np.full_like(found, np.nan)
        remarks.assumed.append(f"{name} is in tenths of a degree: {np.nanmax(np.abs(found)):g} is no angle")
        found = found / 10.0
    found = np.where((np.abs(found) <= _MOST_DEG).all(axis=1, keepdims=True), found, np.nan)
    return found[:, [2, 0, 1]]
