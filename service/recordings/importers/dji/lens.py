"""A film's field of view from the focal length in 35 mm equivalents that its cues tell."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from distloc.types import BoolArray, FloatArray
from service.recordings.importers.dji.words import Words, number_of
from service.recordings.importers.flight import Lens, Remarks

_FULL_FRAME_WIDTH_MM = 36.0
_LEAST_MM, _MOST_MM = 5.0, 2000.0
_TENTHS_FROM = 100.0  # a whole number from here on is in tenths of a millimetre: 240 is 24.0 mm
_SAME_S = 0.001  # a cue's start is cut to so much
_SCALED_FROM = 1000.0  # dzoom_ratio: 10000 is 1
FOCAL_SHARE = 0.05  # one standard deviation


def through_one_lens(rows: Sequence[Words], cue_s: FloatArray, frame_s: FloatArray) -> BoolArray | None:
    """Which frames (N,) were taken at the zoom of most cues, by the cue that each lies in; None: all."""
    focal_mm = [focal_mm_of(row) for row in rows]
    told = Counter(one for one in focal_mm if one is not None)
    if len(told) < 2:
        return None
    is_usual = np.array([one == told.most_common(1)[0][0] for one in focal_mm])
    return np.asarray(is_usual[np.clip(np.searchsorted(cue_s, frame_s + _SAME_S, side="right") - 1, 0, None)])


def lens_of(rows: Sequence[Words], size: tuple[int, int] | None, remarks: Remarks) -> Lens | None:
    """The lens of most cues; None without a film's size. What the cues lack, or differ in, is remarked.

    A film of 16:9 uses the whole width of a sensor of 4:3 (34.6 mm of a 35 mm film's diagonal) or 3:2 (36.0), or is
    cut out of it: 36 mm is right to some 5 %.
    """
    told = Counter(one for row in rows if (one := focal_mm_of(row)) is not None)
    if not told:
        remarks.lacks.append("focal length: --hfov DEGREES, or --config FILE with a [camera]")
    if size is None:
        return None
    if not told:
        return Lens(*size)
    focal_mm, count = told.most_common(1)[0]
    others = sum(told.values()) - count
    if others:
        remarks.lacks.append(
            f"one lens: {others} of {sum(told.values())} cues were zoomed to something else than {focal_mm:g} mm; "
            "frames of theirs are not used"
        )
    hfov_deg = math.degrees(2.0 * math.atan(_FULL_FRAME_WIDTH_MM / 2.0 / focal_mm))
    remarks.found.append(f"lens of {focal_mm:.4g} mm (35 mm equivalent, with its digital zoom)")
    remarks.assumed.append(
        f"field of view {hfov_deg:.1f} degrees across, right to {FOCAL_SHARE:.0%}: films are cut out of the sensor "
        "in ways that nobody tells"
    )
    return Lens(*size, hfov_deg=hfov_deg)


def focal_mm_of(row: Words) -> float | None:
    """In millimetres of a 35 mm film, digital zoom included; None where it is not told."""
    text = row.keyed.get("focal_len")
    value = number_of(text)
    if text is None or not math.isfinite(value):
        return None
    is_whole = "." not in text and "," not in text
    focal_mm = value / 10.0 if is_whole and value >= _TENTHS_FROM else value
    zoom = row.number("dzoom_ratio")
    if math.isfinite(zoom) and zoom > 0.0:
        focal_mm *= zoom / 10_000.0 if zoom >= _SCALED_FROM else zoom
    return round(focal_mm, 3) if _LEAST_MM <= focal_mm <= _MOST_MM else None
