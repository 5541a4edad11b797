"""What `locate` prints: a table of places, decimal minutes first, then what each rests on and what would help."""

import math
from collections.abc import Sequence

from distloc.batch.place import Located, Place, Rejected, Unused
from distloc.types import Ellipse

_MOST_LISTED = 12
_LEAST_TELLING = 6
_NAMED = (
    "north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"
)  # fmt: skip


def table(located: Located, height_name: str) -> list[str]:
    """A line for each place under a header."""
    rows = [("target", "place", "95 % ellipse", "range", "sightings")]
    for place in located.places:
        count = f"{len(place.used)} of {counted(len(place.platforms), 'platform')}"
        rows.append((name_of(place), _where(place, height_name), _ellipse(place), range_words(place), count))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def notes(located: Located, where: Sequence[str]) -> list[str]:
    """For each place which sightings it rests on and what would make it surer, and why others were not used."""
    lines = []
    for place in located.places:
        if place.is_disputed:
            lines.append(f"{place.target}: {disputed(place)}")
        lines.append(f"{place.target}: from {_rows([where[i] for i in place.used])}{_found(place)}")
        lines.append(f"{place.target}: {surer(place)}")
    for one in located.rejected[:_MOST_LISTED]:
        lines.append(f"not used: {where[one.index]}: {why(one, where)}")
    if len(located.rejected) > _MOST_LISTED:
        lines.append(f"not used: {len(located.rejected) - _MOST_LISTED} more: --out has them all in places.geojson")
    return lines + [f"note: {line}" for line in located.notes]


def why(one: Rejected, where: Sequence[str]) -> str:
    """Why a sighting was not used."""
    beside = f"looks {one.beside_deg:.1f} degrees beside" if one.beside_deg is not None else ""
    other = where[one.other] if one.other is not None else ""
    return {
        Unused.DUPLICATE: f"repeats {other} in every number",
        Unused.MISFIT: f"{beside} it, more than the told errors allow: is it something else? a column `target` tells",
        Unused.SAME_PICTURE: f"{beside}, and {other} of the same platform and time fits better",
        Unused.AMBIGUOUS: "lines of sight to several things cross: a column `target` must say which is which",
    }[one.reason]


def name_of(place: Place) -> str:
    """The target's, with a warning where the place is disputed."""
    return f"{place.target} DISPUTED" if place.is_disputed else place.target


def disputed(place: Place) -> str:
    """Who does not bear it out, where that are too many."""
    agree = [name or "unnamed" for name in place.platforms if name not in place.against]
    against = [name or "unnamed" for name in place.against]
    return (
        f"DISPUTED, may be wrong by far more than its ellipse: {listed(agree)} agree{'s' * (len(agree) == 1)}, "
        f"{listed(against)} look{'s' * (len(against) == 1)} elsewhere; any two lines of sight cross nearly somewhere"
    )


def listed(names: Sequence[str]) -> str:
    """`a, b and c`, of many the first."""
    shown = [*names[:_MOST_LISTED], *([f"{len(names) - _MOST_LISTED} more"] if len(names) > _MOST_LISTED else [])]
    return " and ".join([", ".join(shown[:-1]), shown[-1]]) if len(shown) > 1 else "".join(shown) or "nobody"


def surer(place: Place) -> str:
    """What would help most."""
    if not place.is_bounded:
        least = place.bearing.range95_m[0]
        aside = length(0.2 * max(least, 1000.0))
        ground = "" if place.has_ground else ", or the ground's height (--dem, --ground)"
        return f"only a bearing: surer with a sighting from {aside} or more to the side{ground}"
    if place.further is None:
        return "no single sighting more would help much"
    further = place.further
    return (
        f"surer with a sighting from the {compass(further.from_azimuth_rad)}, {length(further.distance_m)} away: "
        f"{ellipse(further.ellipse95)} then"
    )


def decimal_minutes(lat_deg: float, lon_deg: float) -> str:
    """As maps and radios have it: 47°25.664'N 8°36.335'E."""
    return f"{_minutes(lat_deg, 'NS')} {_minutes(lon_deg, 'EW')}"


def range_words(place: Place) -> str:
    """The ranges that hold 95 %, or from where on."""
    low, high = place.bearing.range95_m
    if not place.is_bounded:
        return f"over {length(low)}"
    parts = place.bearing.parts95_m
    if len(parts) > 1:
        return " or ".join(f"{length(a)} to {length(b)}" for a, b in parts[:4])
    return f"{length(low)} to {length(high)}"


def bearing_words(place: Place) -> str:
    """The bearing from its camera, true, with its 95 %."""
    bearing = place.bearing
    return f"{math.degrees(bearing.azimuth_rad):.1f} +- {math.degrees(bearing.azimuth95_rad):.1f} deg true"


def ellipse(one: Ellipse) -> str:
    """Its half-axes and where the longer one points."""
    return f"{length(one.semi_major_m)} x {length(one.semi_minor_m)} at {math.degrees(one.azimuth_rad):.0f} deg"


def length(metres: float) -> str:
    """Three digits of metres or kilometres."""
    if metres < 10.0:
        return f"{metres:.1f} m"
    return f"{metres:.0f} m" if metres < 1000.0 else f"{metres / 1000.0:.{1 if metres < 99_500.0 else 0}f} km"


def compass(azimuth_rad: float) -> str:
    """One of eight directions."""
    return _NAMED[round(math.degrees(azimuth_rad) / 45.0) % 8]


def counted(number: int, noun: str) -> str:
    """`1 platform`, `2 platforms`."""
    return f"{number} {noun}{'s' * (number != 1)}"


def _minutes(angle_deg: float, signs: str) -> str:
    thousandths = round(abs(angle_deg) * 60_000.0)
    degrees, rest = divmod(thousandths, 60_000)
    return f"{degrees}°{rest / 1000.0:06.3f}'{signs[angle_deg < 0.0]}"


def _where(place: Place, height_name: str) -> str:
    if place.lat_deg is None or place.lon_deg is None:
        source = f" from {place.bearing.platform}" if place.bearing.platform else ""
        return f"bearing {bearing_words(place)}{source}"
    height = f" {place.height_m:.0f} m {height_name}" if place.height_m is not None else ""
    return decimal_minutes(place.lat_deg, place.lon_deg) + height


def _ellipse(place: Place) -> str:
    if place.ellipse95 is None:
        return "none"
    return f"{ellipse(place.ellipse95)}{', rough' if place.is_rough else ''}"


def _found(place: Place) -> str:
    """What was found out of the errors; of few sightings it is no more than was taken for likely before."""
    parts = []
    if place.smoke_offset_m > 0.0:
        parts.append(f"smoke is taken to be {length(place.smoke_offset_m)} from its fire")
    if len(place.used) < _LEAST_TELLING:
        return f"; {parts[0]}" if parts else ""
    if place.heading_white_rad > math.radians(0.2):
        parts.append(f"headings jump by about {math.degrees(place.heading_white_rad):.1f} deg")
    if place.scatter_rad > math.radians(0.1):
        parts.append(f"sightings scatter by about {math.degrees(place.scatter_rad):.1f} deg")
    return f"; {', '.join(parts)}" if parts else ""


def _rows(names: list[str]) -> str:
    """`x.csv rows 2-5, 9`: runs of one file's rows as ranges."""
    files: dict[str, list[int]] = {}
    for name in names:
        stem, number = name.rsplit(" ", 1)
        files.setdefault(stem, []).append(int(number))
    return "; ".join(f"{stem}{'s' * (len(numbers) > 1)} {_runs(sorted(numbers))}" for stem, numbers in files.items())


def _runs(numbers: list[int]) -> str:
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    words = [str(a) if a == b else f"{a}-{b}" for a, b in runs]
    return ", ".join(words[:_MOST_LISTED]) + (
        f" and {len(words) - _MOST_LISTED} more runs" if len(words) > _MOST_LISTED else ""
    )
