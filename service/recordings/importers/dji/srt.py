"""DJI's and Autel's subtitle files as flights; the readers' table calls it.

The dialects' users collected how they differ: a cue a frame or a second; places under their names or in GPS(...), with
either number first; heights above home, the sea or neither; angles of the gimbal, the craft or none.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.dji.angles import camera_angles_deg, craft_angles_deg, quaternions
from service.recordings.importers.dji.cues import Cue, cues_of
from service.recordings.importers.dji.film_fit import Fitted, film_beside, on_film
from service.recordings.importers.dji.lens import FOCAL_SHARE, lens_of, through_one_lens
from service.recordings.importers.dji.order import places_of
from service.recordings.importers.dji.track import home_told, track_of
from service.recordings.importers.dji.words import Words, words_of
from service.recordings.importers.flight import Attitudes, Film, Given, ImportedFlight, ImportRefusedError, Remarks
from service.recordings.importers.rows import attitudes_of, count

_GIMBAL_YAW_SIGMA_DEG = 3.0  # a compass among motors, and a gimbal that drifts between its own resets
_CRAFT_YAW_SIGMA_DEG = 5.0  # the camera looks ahead, as far as nobody turned the gimbal; and of Autel's craft
_GIMBAL_TILT_SIGMA_DEG = 1.0
_LEAST_SHARE = 0.5  # of the cues must say something of the flight


def read_srt(path: Path, given: Given) -> ImportedFlight:
    """The flight that a subtitle file tells, with its film if there is one; ImportRefusedError where there is none."""
    remarks = Remarks()
    cues, rows = _told(path, remarks)
    film = film_beside(path, given.films)
    fitted = on_film(path, cues, rows, film, remarks)
    time_s = fitted.time_s
    places = places_of(path.name, rows, time_s, remarks)
    positions, fixes = track_of(rows, time_s, places, remarks)
    camera, craft = _attitudes(rows, time_s, remarks)
    is_autel = any(any(one.axes) for row in rows for one in row.functions.values())
    yaw_sigma_deg = _CRAFT_YAW_SIGMA_DEG if camera is None or is_autel else _GIMBAL_YAW_SIGMA_DEG
    flight = ImportedFlight(
        path.name,
        _epoch_s(rows, time_s, given, remarks),
        positions=positions,
        craft=craft,
        camera=camera,
        fixes=fixes,
        home=home_told(rows, places, remarks),
        position_step_m=places.resolution_m,
        lens=lens_of(rows, fitted.size, remarks),
        frames=_through_one_lens(rows, fitted),
        yaw_sigma_deg=math.hypot(yaw_sigma_deg, math.degrees(FOCAL_SHARE * 0.25)),
        tilt_sigma_deg=_GIMBAL_TILT_SIGMA_DEG if camera is not None else None,
        needs_mount=camera is None,
        remarks=remarks,
    )
    if positions is None and camera is None and craft is None:
        why = ", ".join(f"{number} {reason}" for reason, number in remarks.dropped.items())
        raise ImportRefusedError(f"{path}: no cue of {len(rows)} tells a place with a height{': ' if why else ''}{why}")
    return flight


def _through_one_lens(rows: Sequence[Words], fitted: Fitted) -> Film | None:
    film = fitted.film
    return film and replace(film, is_used=through_one_lens(rows, fitted.time_s, film.time_s))


def _told(path: Path, remarks: Remarks) -> tuple[list[Cue], list[Words]]:
    """Cues in rising time with what they say."""
    cues: list[Cue] = []
    rows: list[Words] = []
    empty = backwards = 0
    for cue in cues_of(path):
        words = words_of(cue.text)
        if not words.keyed and not words.functions:
            empty += 1
        elif cues and cue.start_s <= cues[-1].start_s:
            backwards += 1
        else:
            cues.append(replace(cue, text=""))
            rows.append(words)
    if not cues:
        raise ImportRefusedError(f"{path}: no cue of a flight: a drone's subtitles have [latitude: ...] or GPS(...)")
    if empty > _LEAST_SHARE * (len(cues) + empty):
        raise ImportRefusedError(
            f"{path}: {empty} of {len(cues) + empty} cues say nothing of a flight: other subtitles?"
        )
    count(remarks, "cue: says nothing", empty)
    count(remarks, "cue: time repeated or backwards", backwards)
    return cues, rows


def _attitudes(
    rows: Sequence[Words], time_s: FloatArray, remarks: Remarks
) -> tuple[Attitudes | None, Attitudes | None]:
    """The camera's and the craft's.

    A gimbal holds its camera level, so where a craft's angles are all there is only the heading is the camera's.
    """
    camera_deg = camera_angles_deg(rows, remarks)
    craft_deg = craft_angles_deg(rows, remarks)
    if (camera := _finite(time_s, camera_deg, remarks, "gimbal")) is not None:
        remarks.found.append(f"the gimbal's angles from north, {len(camera.time_s)} of {len(rows)} cues")
        return camera, _finite(time_s, craft_deg, remarks, "craft")
    level = np.stack([craft_deg[:, 0], *np.zeros((2, len(craft_deg)))], axis=1)
    if (craft := _finite(time_s, level, remarks, "craft")) is not None:
        remarks.lacks.append("the gimbal's angles: --mount says how far the camera looked down")
        remarks.assumed.append("the camera looks ahead and the gimbal holds it level: the craft's tilt is left out")
        return None, craft
    remarks.lacks.append("the camera's attitude: --attitude FILE, or a mount with a large sigma, must tell it")
    return None, None


def _finite(time_s: FloatArray, angles_deg: FloatArray, remarks: Remarks, name: str) -> Attitudes | None:
    if not np.isfinite(angles_deg).all(axis=1).any():
        return None
    return attitudes_of(time_s, quaternions(angles_deg), remarks, name=name)


def _epoch_s(rows: Sequence[Words], time_s: FloatArray, given: Given, remarks: Remarks) -> float | None:
    """UNIX time of the film's start, from the median of all dates."""
    starts = [one.local_s - t for one, t in zip(rows, time_s, strict=True) if one.local_s is not None]
    if not starts:
        remarks.lacks.append("the date and time: no cue has one")
        return None
    if given.utc_offset_s is None:
        remarks.assumed.append("dates are taken as UTC: they are the craft's local time, its zone is not told")
    return float(np.median(starts)) - (given.utc_offset_s or 0.0)
