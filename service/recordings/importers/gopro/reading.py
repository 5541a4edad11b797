"""A GoPro's film to a flight: its receiver's places, its own orientation; of a Karma its autopilot's telemetry."""

from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from distloc.types import BoolArray, FloatArray
from service.recordings.importers.film import film_of
from service.recordings.importers.flight import (
    Fixes,
    Given,
    ImportedFlight,
    ImportRefusedError,
    Lens,
    Positions,
    Remarks,
)
from service.recordings.importers.gopro.karma import karma_part
from service.recordings.importers.gopro.mp4_track import payloads, read_track
from service.recordings.importers.gopro.orientation import camera_attitudes
from service.recordings.importers.gopro.series import Series, gathered
from service.recordings.importers.rows import count, fixes_of, positions_of

_WANTED = frozenset({"GPS5", "GPS9", "CORI", "IORI", "GRAV", "GYRO", "ATTD", "GLPI", "GPRI", "CYTS", "SYST"})
_GPS_EPOCH_S = 946_684_800.0  # 2000-01-01, from which GPS9 counts days
_DAY_S = 86_400.0
_FIX = {0: 1, 2: 2, 3: 3}  # GPSF to MAVLink's: none, 2D, 3D
_DOP_M = 5.0  # of a GoPro's receiver at a dilution of 1, taken from what its users measure
_LATEST_S = 4_102_444_800.0  # 2100


def read_gopro(path: Path, given: Given) -> ImportedFlight:
    """The flight and its film, both on the film's clock; ImportRefusedError where nothing of either can be used."""
    track = read_track(path)
    remarks = Remarks()
    series, silent = gathered(payloads(path, track), track.times_s, _WANTED)
    count(remarks, "telemetry: a payload without streams", silent)
    if not series:
        raise ImportRefusedError(f"{path}: its track of telemetry has none of {', '.join(sorted(_WANTED))}")
    lens, film, film_remarks = film_of(path)
    remarks.found.extend(film_remarks.found)
    for key in sorted(series):
        remarks.found.append(f"stream {key} of {series[key].device or 'the camera'}: {_rate(series[key])}")
    if "ATTD" in series and ("GLPI" in series or "GPRI" in series):
        return karma_part(path.name, series, lens, film, remarks)
    positions, fixes, epoch_s = _places(series, remarks)
    camera = camera_attitudes(series, film.time_s, positions, given.by_course, remarks)
    return ImportedFlight(
        source=path.name,
        epoch_s=epoch_s,
        positions=positions,
        camera=None if camera is None else camera.attitudes,
        fixes=fixes,
        lens=Lens(lens.width, lens.height),
        frames=film,
        frames_tied=positions is not None or camera is not None,
        yaw_sigma_deg=None if camera is None else camera.yaw_sigma_deg,
        tilt_sigma_deg=None if camera is None else camera.tilt_sigma_deg,
        remarks=remarks,
    )


def _places(series: dict[str, Series], remarks: Remarks) -> tuple[Positions | None, Fixes | None, float | None]:
    """Places, the receiver's word, and UTC of the film's first frame."""
    one = series.get("GPS9") or series.get("GPS5")
    if one is None:
        remarks.lacks.append("places: the camera's receiver was off, or it has none")
        return None, None, None
    values, times_s = one.values, one.even_times_s()
    if values.shape[1] < (9 if one.key == "GPS9" else 5):
        remarks.lacks.append(f"places: {one.key} has {values.shape[1]} columns")
        return None, None, None
    fix, dop = _fix_and_dop(one)
    has_fix = fix >= 2
    count(remarks, "position: no fix", int((~has_fix).sum()))
    is_msl = one.first.text("GPSA") == "MSLV"
    height_m = {"alt_msl_m" if is_msl else "alt_ellipsoid_m": values[has_fix, 2]}
    positions = positions_of(times_s[has_fix], values[has_fix, 0], values[has_fix, 1], remarks, **height_m)
    fixes = fixes_of(times_s, fix, remarks, h_acc_m=_DOP_M * dop, v_acc_m=1.5 * _DOP_M * dop)
    epoch_s = _epoch_s(one, times_s, has_fix)
    if epoch_s is None:
        remarks.lacks.append("the receiver's UTC")
    remarks.assumed.append("the receiver's places are of when they were written: a GoPro tells no delay")
    return positions, fixes, epoch_s


def _fix_and_dop(
    one: Series,
) -> tuple[FloatArray, FloatArray]:
    """(N,) each, the fix as MAVLink has it; GPS5 has them once a payload."""
    if one.key == "GPS9":
        told, dop = one.values[:, 8], one.values[:, 7]
    else:
        by_payload = {number: stream for number, stream in one.notes}
        told = np.array([by_payload[number].number("GPSF") or 0.0 for number in one.payload.tolist()])
        dop = np.array([(by_payload[number].number("GPSP") or np.nan) / 100.0 for number in one.payload.tolist()])
    fix = np.array([_FIX.get(int(kind) if np.isfinite(kind) else 0, 1) for kind in told], dtype=np.float64)
    return fix, np.where((dop > 0.0) & (dop < 100.0), dop, np.nan)


def _epoch_s(
    one: Series,
    times_s: FloatArray,
    has_fix: BoolArray,
) -> float | None:
    """UTC less the film's time, by the median: the first stamps after the receiver woke are often stale."""
    if one.key == "GPS9":
        utc_s = _GPS_EPOCH_S + one.values[:, 5] * _DAY_S + one.values[:, 6]
        offsets = (utc_s - times_s)[has_fix]
    else:
        first_of = np.concatenate([[0], np.cumsum([len(part) for part in one.parts])[:-1]])
        stamps = [
            (_utc_s(stream.text("GPSU")), times_s[at]) for (_, stream), at in zip(one.notes, first_of, strict=True)
        ]
        offsets = np.array([utc - at for utc, at in stamps if utc is not None])
    offsets = offsets[np.isfinite(offsets) & (offsets > 0.0) & (offsets < _LATEST_S)]
    return float(np.median(offsets)) if len(offsets) else None


def _utc_s(text: str) -> float | None:
    """GPSU: yymmddhhmmss.sss."""
    try:
        return datetime.strptime(text, "%y%m%d%H%M%S.%f").replace(tzinfo=timezone.utc).timestamp()
    except ValueError:
        return None


def _rate(one: Series) -> str:
    if one.count < 2:
        return f"{one.count}"
    return f"{one.count}, {1.0 / float(np.median(np.diff(one.even_times_s()))):.1f} a second"
