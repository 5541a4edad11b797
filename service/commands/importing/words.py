"""What `distloc import` prints: what was found, what lacks, what was assumed, which rows were left out."""

import math
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from service.recordings.importers.flight import Film, ImportedFlight, Remarks
from service.recordings.importers.join import overlap_s, time_span
from service.recordings.importers.output.resampling import Resampled
from service.recordings.importers.output.sightings_table import has_pose

_MOST_LINES = 20


def table(flight: ImportedFlight, out: Path | None, sightings: Path | None, rows: int | None) -> list[str]:
    """A line for each thing, under what it is; the last lines say what to do with what was written."""
    lines = [f"{flight.source} -> {', '.join(str(one) for one in (out, sightings) if one)}"]
    for title, entries in (
        ("found", [*_found(flight), *flight.remarks.found]),
        ("lacks", [*_lacks(flight), *flight.remarks.lacks]),
        ("doubt", flight.remarks.doubt),
        ("assumed", flight.remarks.assumed),
        ("dropped", [f"{number} x {reason}" for reason, number in sorted(flight.remarks.dropped.items())]),
    ):
        for number, entry in enumerate(entries[:_MOST_LINES]):
            lines.append(f"{title if number == 0 else '':<9}{entry}")
        if len(entries) > _MOST_LINES:
            lines.append(f"{'':<9}and {len(entries) - _MOST_LINES} more")
    if sightings is not None:
        lines.append(f"next: mark the smoke in u_px, v_px of {rows} rows, then: distloc locate {sightings} --out DIR")
    return lines if out is None else [*lines, f"next: distloc replay {out}"]


def note_resampled(remarks: Remarks, attitudes: Resampled, positions: Resampled, has_errors: bool) -> None:
    """Say what was filled in, what that costs, and what stays open."""
    for name, one, unit, size in (
        ("attitudes", attitudes, "deg", math.degrees(attitudes.error)),
        ("positions", positions, "m", positions.error),
    ):
        if one.filled:
            told = "your config's errors stay" if has_errors else "the errors told are larger by that"
            remarks.assumed.append(
                f"{one.filled} {name} between those told, at 10 a second: they err by {size:.2f} {unit}; {told}"
            )
        if one.gaps:
            remarks.lacks.append(f"{name} in {one.gaps} gaps too long to fill: frames in them have no pose")


def _found(flight: ImportedFlight) -> list[str]:
    assert flight.positions is not None and flight.craft is not None
    first_s, last_s = time_span(flight)
    positions = flight.positions
    when = "" if flight.epoch_s is None else f" from {_utc(flight.epoch_s + first_s)}"
    place = f"{positions.lat_deg[0]:.5f}, {positions.lon_deg[0]:.5f}, {positions.alt_msl_m[0]:.0f} m"
    lines = [
        f"{last_s - first_s:.1f} s of flight{when} at {place}",
        f"positions: {_rate(positions.time_s)}",
        f"attitudes: {_rate(flight.craft.time_s)}",
    ]
    if flight.gimbal is not None:
        lines.append(
            f"gimbal's attitudes: {_rate(flight.gimbal.attitudes.time_s)}, yaw from "
            f"{'north' if flight.gimbal.yaw_from == 'earth' else 'the nose'}"
        )
    if flight.frames is not None:
        inside = overlap_s(flight.frames.time_s, (first_s, last_s))
        kind = "frames" if isinstance(flight.frames, Film) else "pictures"
        bare = inside - int(has_pose(flight).sum())
        gaps = f", {bare} of these in gaps without one" if bare > 0 else ""
        lines.append(f"{kind}: {len(flight.frames.time_s)}, {inside} of them during the poses{gaps}")
    return lines


def _lacks(flight: ImportedFlight) -> list[str]:
    lacking = {
        "a date: the recording's clock begins in 1970": flight.epoch_s is None,
        "frames: the recording is a log alone": flight.frames is None,
        "the receiver's fix: it is taken for a 3D fix all along": flight.fixes is None,
        "the estimator's own word on its health": flight.estimates is None,
    }
    return [name for name, is_lacking in lacking.items() if is_lacking]


def _rate(times_s: np.ndarray[tuple[int], np.dtype[np.float64]]) -> str:
    if len(times_s) < 2:
        return "1"
    steps_s = np.diff(times_s)
    return f"{len(times_s)}, {1.0 / float(np.median(steps_s)):.1f} a second, longest gap {steps_s.max():.1f} s"


def _utc(epoch_s: float) -> str:
    return datetime.fromtimestamp(epoch_s, timezone.utc).strftime("%Y-%m-%d %H:%M:%SZ")
