"""When each picture was taken: by the zone or the receiver's time in its EXIF, else as the user says. Free of I/O."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.flight import Given, IntArray, Remarks
from service.recordings.importers.stills.exif import Exif

_QUARTER_S = 900.0  # all zones are whole quarters of an hour
_MOST_OFF_S = 60.0  # a camera's clock is set by the receiver
_MOST_ZONE_S = 14 * 3600.0


@dataclass(frozen=True)
class Times:
    """`order` (N,) of the pictures by time; `time_s` (N,) in whole milliseconds after `epoch_s`, in that order.

    A pose and its picture then have one time to the last digit, which is what a replay asks for. `is_sure`: their zone
    is known, so that they are a log's times, too.
    """

    order: IntArray
    time_s: FloatArray
    epoch_s: float
    is_sure: bool


def times_of(exifs: Sequence[Exif], names: Sequence[str], given: Given, remarks: Remarks) -> Times:
    """UTC of each picture; pictures of one second without parts of it are spread over it in the order of names."""
    zone_s = _zone_s(exifs, given, remarks)
    utc_s = np.array([_utc_s(one, zone_s) for one in exifs])
    order = np.array(sorted(range(len(exifs)), key=lambda i: (utc_s[i], names[i])), dtype=np.int64)
    utc_s = utc_s[order]
    epoch_s = float(np.floor(utc_s[0]))
    time_s = np.round(_spread(utc_s - epoch_s), 3)
    if not any(one.has_subseconds for one in exifs) and len(exifs) > 1:
        remarks.assumed.append("pictures' times are in whole seconds")
    is_sure = given.utc_offset_s is not None or any(one.gps_s is not None or one.zone_s is not None for one in exifs)
    return Times(order, time_s, epoch_s, is_sure)


def _utc_s(exif: Exif, zone_s: float) -> float:
    if exif.local_s is None:
        assert exif.gps_s is not None
        return exif.gps_s
    return exif.local_s - (zone_s if exif.zone_s is None else exif.zone_s)


def _zone_s(exifs: Sequence[Exif], given: Given, remarks: Remarks) -> float:
    """Local time minus UTC: the user's word, else by the receiver's times, else none, which is said."""
    lacking = [one for one in exifs if one.zone_s is None and one.local_s is not None]
    if not lacking:
        return 0.0
    if given.utc_offset_s is not None:
        return given.utc_offset_s
    both = [one.local_s - one.gps_s for one in lacking if one.local_s is not None and one.gps_s is not None]
    if both:
        apart_s = float(np.median(both))
        zone_s = round(apart_s / _QUARTER_S) * _QUARTER_S
        if abs(apart_s - zone_s) < _MOST_OFF_S and abs(zone_s) <= _MOST_ZONE_S:
            remarks.found.append(f"local time is UTC {zone_s / 3600.0:+.2f} h, by the receiver's time")
            return zone_s
        remarks.assumed.append(f"the camera's clock is {apart_s:.0f} s from the receiver's, which is believed")
        return apart_s
    remarks.assumed.append("pictures' times are taken as UTC: their zone is not told: --utc-offset HOURS")
    return 0.0


def _spread(time_s: FloatArray) -> FloatArray:
    """Equal times, in order, put evenly into the time until the next, of a second at most."""
    out = time_s.copy()
    starts = np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 0.0)
    for start, end in zip(starts, [*starts[1:], len(time_s)], strict=True):
        if end - start > 1:
            room_s = min(1.0, time_s[end] - time_s[start]) if end < len(time_s) else 1.0
            out[start:end] += np.arange(end - start) * room_s / (end - start)
    return out
