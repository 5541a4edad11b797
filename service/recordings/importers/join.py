"""Parts of one flight, from several sources, to one: clocks tied by their dates, each thing told by the first that can.

Free of I/O.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.flight import ImportedFlight, ImportRefusedError, Lens, Remarks, Stills
from service.recordings.importers.rows import LONGEST_S, count

_POSES = ("positions", "craft", "gimbal", "camera", "fixes", "estimates")
_ONCE = ("home", "frames", "triggers_s", "yaw_sigma_deg", "tilt_sigma_deg", "position_step_m")
_ZONE_QUARTERS = [sign * quarter for quarter in (*range(2, 57, 2), 23, 35, 51) for sign in (1, -1)]  # half hours; Nepal


def joined(parts: Sequence[ImportedFlight]) -> ImportedFlight:
    """One flight of all parts; what is told twice is taken from the part named first, and that is said.

    Raises ImportRefusedError where clocks with a date and without one should tell poses of one flight.
    """
    epochs = [one.epoch_s for one in parts if one.epoch_s is not None]
    epoch_s = epochs[0] if epochs else None
    remarks = Remarks()
    values: dict[str, Any] = {}
    told_by: dict[str, str] = {}
    for part in parts:
        _add_remarks(remarks, part, len(parts) > 1)
        shifted = _on_clock(part, epoch_s, len(parts) > 1, remarks)
        for name in (*_POSES, *_ONCE):
            value = getattr(shifted, name)
            if value is None:
                continue
            if name in values:
                remarks.assumed.append(f"{_plain(name)} of {told_by[name]}, not of {part.source}")
                continue
            values[name], told_by[name] = value, part.source
        if shifted.frames is not None and told_by["frames"] == part.source:
            values["frames_tied"], values["tied_within_s"] = shifted.frames_tied, shifted.tied_within_s
        values["lens"] = _lens(values.get("lens"), shifted.lens)
    has_camera = "camera" in values or "gimbal" in values
    values["needs_mount"] = not has_camera and any(
        one.needs_mount and told_by.get("craft") == one.source for one in parts
    )
    source = " + ".join(one.source for one in parts)
    return ImportedFlight(source=source, epoch_s=epoch_s, remarks=remarks, **values)


def shifted_by(
    flight: ImportedFlight, by_s: float, names: Sequence[str] = (*_POSES, "frames", "triggers_s")
) -> ImportedFlight:
    """The same with `by_s` added to the times of what is named."""
    return replace(flight, **{name: _shifted(getattr(flight, name), by_s) for name in names})


def time_span(flight: ImportedFlight) -> tuple[float, float]:
    """First and last time of the poses; ImportRefusedError where that is no flight."""
    times = [getattr(flight, name).time_s for name in ("positions", "craft", "camera") if getattr(flight, name)]
    first_s, last_s = min(float(one[0]) for one in times), max(float(one[-1]) for one in times)
    if last_s - first_s > LONGEST_S:
        raise ImportRefusedError(
            f"{flight.source}: its poses are {(last_s - first_s) / 3600.0:.0f} h apart: one flight, of at most "
            f"{LONGEST_S / 3600.0:.0f} h, is wanted"
        )
    return first_s, last_s


def _on_clock(part: ImportedFlight, epoch_s: float | None, is_one_of_many: bool, remarks: Remarks) -> ImportedFlight:
    """On the clock whose zero is `epoch_s`; a film that is tied to nothing keeps its own."""
    has_poses = any(getattr(part, name) is not None for name in _POSES)
    if epoch_s is None or part.epoch_s == epoch_s:
        if epoch_s is None and is_one_of_many and has_poses:
            remarks.assumed.append(f"{part.source}: its times are on the same clock as the others'; none has a date")
        return part
    if part.epoch_s is not None:
        moved = shifted_by(part, part.epoch_s - epoch_s)
        return moved if part.frames_tied else replace(moved, frames=part.frames)
    if has_poses:
        raise ImportRefusedError(
            f"{part.source}: has times without a date beside a source that has one: how do they belong together? "
            "give times as 2026-07-14T09:30:00Z"
        )
    return part


def _shifted(value: Any, by_s: float) -> Any:
    if value is None:
        return None
    if isinstance(value, np.ndarray):
        return value + by_s
    if hasattr(value, "attitudes"):
        return replace(value, attitudes=_shifted(value.attitudes, by_s))
    times_s: FloatArray = value.time_s
    return replace(value, time_s=times_s + by_s)


def _lens(one: Lens | None, other: Lens | None) -> Lens | None:
    """The size is the pictures'; where a log tells the lens and the film its size, both."""
    if one is None or other is None:
        return one or other
    if one.fx is None and one.hfov_deg is None:
        scale = one.width / other.width if other.width else 1.0
        return Lens(one.width, one.height, None if other.fx is None else other.fx * scale, other.hfov_deg)
    return one


def _add_remarks(remarks: Remarks, part: ImportedFlight, is_named: bool) -> None:
    prefix = f"{part.source}: " if is_named else ""
    for one in fields(Remarks):
        if one.name == "dropped":
            for reason, number in part.remarks.dropped.items():
                count(remarks, f"{prefix}{reason}", number)
        else:
            getattr(remarks, one.name).extend(f"{prefix}{line}" for line in getattr(part.remarks, one.name))


def _plain(name: str) -> str:
    return {"craft": "the craft's attitude", "camera": "the camera's attitude", "positions": "the place"}.get(
        name, name.replace("_", " ")
    )


def released(flight: ImportedFlight) -> ImportedFlight:
    """Stills that are tied to no clock, by the log's releases of the camera where there are as many of both.

    Others stay as they are where they have times of their own, else ImportRefusedError.
    """
    frames, triggers_s = flight.frames, flight.triggers_s
    assert isinstance(frames, Stills)
    number = 0 if triggers_s is None else len(triggers_s)
    if triggers_s is not None and number == len(frames.paths):
        has_times = bool(np.isfinite(frames.time_s).all())
        order = np.argsort(frames.time_s, kind="stable") if has_times else np.arange(number)
        flight.remarks.found.append(f"clock: {number} pictures by as many releases of the camera, in order")
        paths = [frames.paths[int(i)] for i in order]
        return replace(flight, frames=Stills(paths, triggers_s), frames_tied=True)
    if np.isfinite(frames.time_s).all():
        return flight
    told = f"the log has {number} releases of the camera for {len(frames.paths)} of them" if number else "no log tells"
    raise ImportRefusedError(
        f"{flight.source}: when the pictures were taken is not known: {told}; give a frames.csv (stamp_us,file), or "
        "names that hold the time"
    )


def overlap_s(frames_s: FloatArray, span_s: tuple[float, float]) -> int:
    """How many frames lie within the poses."""
    return int(((frames_s >= span_s[0]) & (frames_s <= span_s[1])).sum())


def check_overlap(flight: ImportedFlight) -> None:
    """ImportRefusedError where tied frames and poses have no time in common: a zone, most often."""
    if flight.frames is None or not flight.frames_tied:
        return
    first_s, last_s = time_span(flight)
    frames_s = np.sort(flight.frames.time_s)
    if overlap_s(frames_s, (first_s, last_s)):
        return
    apart_s = float(frames_s[0]) - first_s
    hours = abs(apart_s) / 3600.0
    hint = ": are they of one flight?"
    if any(overlap_s(frames_s - quarter * 900.0, (first_s, last_s)) for quarter in _ZONE_QUARTERS):
        hint = ": is a local time taken for UTC? --utc-offset HOURS"
    raise ImportRefusedError(
        f"{flight.source}: no frame was taken during the poses: the first one {hours:.2f} h "
        f"{'after' if apart_s > 0 else 'before'} the first pose{hint}"
    )
