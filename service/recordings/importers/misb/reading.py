"""A film in MPEG-TS with MISB ST 0601 metadata to a flight: places, attitudes and lens by its packets' own stamps.

The pictures' times are their presentation times, tied to the packets' stamps: bound packets (stream type 0x15) carry a
presentation time, others lie beside their picture in the stream.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from distloc.geometry.rotations import quaternion_from_euler
from distloc.types import BoolArray, FloatArray
from service.common import st0601
from service.common.st0601 import Tag
from service.recordings.importers.film import film_of
from service.recordings.importers.flight import Film, Given, ImportedFlight, ImportRefusedError, Lens, Remarks, unknown
from service.recordings.importers.misb.mpegts import Contents, Unit, read_contents
from service.recordings.importers.rows import attitudes_of, count, positions_of

_TIED_S = 0.1  # pictures and stamps whose offsets spread by less are on one clock
_BESIDE_S = 0.3  # by which metadata that is not bound may come before or after its picture
_SAME_S, _SAME_SHARE = 0.002, 0.95  # of a frame's time and a picture's in the stream
_ZOOMED = 0.02  # of the field of view: a picture with another is not this lens'
_LEAST_UTC_S, _MOST_UTC_S = 0.0, 4_102_444_800.0  # to 2100
_READ = tuple(
    tag
    for tag in st0601.ITEMS
    if tag not in (Tag.TIME_US, Tag.LEAP_S, Tag.CORRECTION_US, Tag.VERSION, Tag.CE90, Tag.LE90)
)


@dataclass(frozen=True)
class _Table:
    """`utc_s` (N,) in the stream's order, `pts_s` (N,) NaN where none; `items` by tag (N,), NaN where not told."""

    utc_s: FloatArray
    pts_s: FloatArray
    items: dict[int, FloatArray]

    def first_of(self, *tags: int) -> FloatArray:
        """The first of these that is told, in each row."""
        out = self.items[tags[0]].copy()
        for tag in tags[1:]:
            out = np.where(np.isfinite(out), out, self.items[tag])
        return out


def read_misb(path: Path, given: Given) -> ImportedFlight:
    """The flight and its film; ImportRefusedError where no packet can be used or no picture decoded."""
    contents = read_contents(path)
    remarks = Remarks()
    table = _table(path, contents, remarks)
    lens, film, film_remarks = film_of(path)
    remarks.found.extend(film_remarks.found)
    epoch_s = float(np.floor(table.utc_s.min()))
    time_s = table.utc_s - epoch_s
    frames_s, is_tied, within_s = _frame_times(path, contents, film.time_s, table, epoch_s, remarks)
    is_lens, hfov_deg = _lens_rows(table, remarks)
    positions = positions_of(
        time_s,
        table.items[Tag.SENSOR_LAT],
        table.items[Tag.SENSOR_LON],
        remarks,
        alt_msl_m=table.items[Tag.SENSOR_ALT_MSL],
        alt_ellipsoid_m=table.first_of(Tag.SENSOR_HEIGHT_EXTENDED, Tag.SENSOR_HEIGHT),
    )
    craft_q = _quaternions(
        table.items[Tag.HEADING], table.first_of(Tag.PITCH_FULL, Tag.PITCH), table.first_of(Tag.ROLL_FULL, Tag.ROLL)
    )
    relative = [table.items[tag] for tag in (Tag.RELATIVE_AZIMUTH, Tag.RELATIVE_ELEVATION, Tag.RELATIVE_ROLL)]
    camera_q = _product(craft_q, _quaternions(relative[0], relative[1], np.nan_to_num(relative[2])))
    has_camera: BoolArray = np.asarray(np.isfinite(camera_q).all(axis=1))
    craft = attitudes_of(time_s, craft_q, remarks, name="platform's attitude") if np.isfinite(craft_q).any() else None
    camera = None
    if has_camera.any():
        kept = has_camera & is_lens
        camera = attitudes_of(time_s[kept], camera_q[kept], remarks, name="sensor's attitude")
    _say(remarks, table, np.asarray(np.isfinite(craft_q).all(axis=1)), has_camera)
    return ImportedFlight(
        source=path.name,
        epoch_s=epoch_s,
        positions=positions,
        craft=craft,
        camera=camera,
        lens=Lens(lens.width, lens.height, hfov_deg=hfov_deg),
        frames=Film(path, frames_s),
        frames_tied=is_tied,
        tied_within_s=within_s,
        remarks=remarks,
    )


def _table(path: Path, contents: Contents, remarks: Remarks) -> _Table:
    """Each packet that can be used; the others are counted by reason."""
    rows: list[dict[int, float]] = []
    pts_s: list[float] = []
    faults: Counter[str] = Counter()
    for unit in contents.units:
        found = st0601.packets(unit.data)
        if not found:
            faults["metadata: no whole packet of ST 0601"] += 1
        for packet in found:
            row = st0601.decoded(packet)
            if isinstance(row, st0601.Fault):
                faults[f"metadata: {row.value}"] += 1
            elif not _LEAST_UTC_S < st0601.utc_s(row) < _MOST_UTC_S:
                faults["metadata: a time before 1970 or after 2100"] += 1
            else:
                rows.append(row)
                pts_s.append(_pts_of(unit))
    if contents.lost:
        faults["stream: packets cut or lost"] += contents.lost
    for reason, number in faults.items():
        count(remarks, reason, number)
    if not rows:
        told = ", ".join(f"{number} {reason}" for reason, number in faults.items()) or "none in the stream"
        raise ImportRefusedError(
            f"{path}: no packet of ST 0601 can be used ({told}); a UAS Datalink Local Set is wanted"
        )
    if contents.is_sync and np.isfinite(pts_s).all():  # the stream may have them in the order of decoding
        order = np.argsort(pts_s, kind="stable")
        rows, pts_s = [rows[i] for i in order], [pts_s[i] for i in order]
    items = {tag: np.array([row.get(tag, np.nan) for row in rows], dtype=np.float64) for tag in _READ}
    return _Table(np.array([st0601.utc_s(row) for row in rows]), np.array(pts_s), items)


def _pts_of(unit: Unit) -> float:
    """Of what is not bound to a time, that of the picture that it lies behind."""
    told = unit.pts_s if unit.pts_s is not None else unit.video_pts_s
    return np.nan if told is None else told


def _frame_times(
    path: Path, contents: Contents, film_s: FloatArray, table: _Table, epoch_s: float, remarks: Remarks
) -> tuple[FloatArray, bool, float | None]:
    """The film's frames on the flight's clock, whether they are tied to it, and if not, within how much they are."""
    offsets_s = (table.utc_s - table.pts_s)[np.isfinite(table.pts_s)]
    if not len(offsets_s) or not contents.picture_pts_s:
        remarks.lacks.append("times that tie pictures and metadata: no presentation times")
        return film_s, False, None
    offset_s = float(np.median(offsets_s))
    spread_s = float(np.median(np.abs(offsets_s - offset_s)))
    shown_s, is_sure = _shown_s(path, contents, film_s, remarks)
    is_tied = contents.is_sync and spread_s < _TIED_S and is_sure
    how = "bound to the pictures" if contents.is_sync else "beside the pictures, not bound to them"
    remarks.found.append(f"clocks tied by {len(offsets_s)} packets {how}: they spread by {spread_s * 1e3:.0f} ms")
    if not contents.is_sync:
        remarks.assumed.append("a packet belongs to the picture before it in the stream: none is bound to one")
    return shown_s + offset_s - epoch_s, is_tied, None if is_tied else max(_BESIDE_S, 3.0 * spread_s)


def _shown_s(path: Path, contents: Contents, film_s: FloatArray, remarks: Remarks) -> tuple[FloatArray, bool]:
    """The presentation times of the film's decoded frames, and whether they are pictures' own.

    Where a film was cut between two whole pictures the first ones cannot be decoded: OpenCV counts from the first that
    lies in the stream, decoded or not.
    """
    pts_s = np.sort(np.array(contents.picture_pts_s))
    if len(pts_s) == len(film_s) and (np.diff(pts_s) > 0.0).all():
        return pts_s, True
    shown_s = contents.picture_pts_s[0] + _first_s(path) + film_s
    nearest = np.clip(np.searchsorted(pts_s, shown_s - _SAME_S), 0, len(pts_s) - 1)
    share = float(np.mean(np.abs(pts_s[nearest] - shown_s) < _SAME_S))
    remarks.assumed.append(
        f"{len(film_s)} of {len(pts_s)} pictures were decoded; {share:.0%} of them at a picture's time in the stream"
    )
    return shown_s, share > _SAME_SHARE


def _first_s(path: Path) -> float:
    """When OpenCV shows the first frame, by its own count."""
    capture = cv2.VideoCapture(str(path))
    try:
        return float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3 if capture.grab() else 0.0
    finally:
        capture.release()


def _lens_rows(table: _Table, remarks: Remarks) -> tuple[BoolArray, float | None]:
    """The commonest field of view, and which rows have it: a zoomed picture is another lens'."""
    hfov_deg = table.items[Tag.HFOV]
    told = hfov_deg[np.isfinite(hfov_deg) & (hfov_deg > 0.0)]
    if not len(told):
        remarks.lacks.append("the field of view (item 16)")
        return np.ones(len(hfov_deg), dtype=np.bool_), None
    sizes, counts = np.unique(np.round(np.log(told) / _ZOOMED), return_counts=True)
    common = np.round(np.log(told) / _ZOOMED) == sizes[np.argmax(counts)]
    usual_deg = float(np.median(told[common]))
    is_usual = ~(np.abs(hfov_deg / usual_deg - 1.0) > _ZOOMED)  # not told: as before
    if not is_usual.all():
        count(remarks, "sensor's attitude: another field of view", int((~is_usual).sum()))
        remarks.lacks.append(f"pictures with another field of view than {usual_deg:.1f} deg are not used: it zooms")
    return is_usual, usual_deg


def _quaternions(yaw_deg: FloatArray, pitch_deg: FloatArray, roll_deg: FloatArray) -> FloatArray:
    """(N, 4), NaN where an angle is not told."""
    angles = np.radians(np.stack([yaw_deg, pitch_deg, roll_deg], axis=1))
    out = unknown(len(angles), 4)
    for i in np.flatnonzero(np.isfinite(angles).all(axis=1)):
        out[i] = quaternion_from_euler(*(float(one) for one in angles[i]))
    return out


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton's product of quaternions (N, 4), w first."""
    w, x, y, z = a.T
    p, q, r, s = b.T
    return np.stack(
        [
            w * p - x * q - y * r - z * s,
            w * q + x * p + y * s - z * r,
            w * r - x * s + y * p + z * q,
            w * s + x * r - y * q + z * p,
        ],
        axis=1,
    )


def _say(remarks: Remarks, table: _Table, has_craft: BoolArray, has_camera: BoolArray) -> None:
    rate = ""
    if len(table.utc_s) > 1 and np.ptp(table.utc_s) > 0.0:
        rate = f", {(len(table.utc_s) - 1) / float(np.ptp(table.utc_s)):.1f} a second"
    remarks.found.append(f"metadata of ST 0601: {len(table.utc_s)} packets{rate}")
    for name, has in (("platform's attitude (5 to 7)", has_craft), ("sensor's angles (18 to 20)", has_camera)):
        if not has.any():
            remarks.lacks.append(f"the {name}")
        elif not has.all():
            remarks.lacks.append(f"the {name} in {int((~has).sum())} of {len(has)} packets")
    if not np.isfinite(table.items[Tag.SENSOR_ALT_MSL]).any():
        remarks.lacks.append("the sensor's height over the sea (15)")
