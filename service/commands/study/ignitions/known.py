"""Tables as fires of known ignition: which sightings are of which fire, and where each began."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from distloc.batch.sighting import Sighting
from distloc.study.ignitions.known import Ignition, KnownFire
from service.recordings.sightings.columns import RowError, numbers_of, texts_of
from service.recordings.sightings.reading import Record, SightingsError, Table, read_table
from service.recordings.sightings.suspects import far_apart

_OF = ("ignition", "ign", "fire", "true", "truth")
_PLACES = {
    "lat": ("lat", "lat_deg", "latitude", *(f"{of}_lat" for of in _OF)),
    "lon": ("lon", "lon_deg", "longitude", "lng", "long", *(f"{of}_lon" for of in _OF)),
}
_SIGMAS = ("ignition_sigma_m", "ign_sigma_m", "sigma_m", "uncertainty_m")
_NAMES = ("fire", "target", "name", "fire_id", "id", "event", "incident")
IGNITION_COLUMNS = frozenset({f"{of}_{name}" for of in _OF for name in _PLACES} | set(_SIGMAS[:2]))
_MOST_LISTED = 8
_MOST_SIGMA_M = 100_000.0


@dataclass(slots=True)
class Ignitions:
    """Places by the fire's name, and a line for each row that says none."""

    by_fire: dict[str, Ignition] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    _contradicted: set[str] = field(default_factory=set)

    def add(self, where: str, fire: str, one: Ignition) -> None:
        """A fire begins in one place: two of them are none."""
        if fire in self._contradicted or self.by_fire.setdefault(fire, one) == one:
            return
        self._contradicted.add(fire)
        del self.by_fire[fire]
        self.faults.append(f"{where}: fire {fire!r} begins elsewhere than an earlier row says: it is not scored")


def ignitions_of(tables: Sequence[Table], path: Path | None) -> Ignitions:
    """Of the sightings' own columns and, where it is given, of a table of its own; SightingsError where it is none."""
    found = Ignitions()
    for table in tables:
        for record in table.records:
            cells = {_ours(name): cell for name, cell in record.cells.items() if name in IGNITION_COLUMNS}
            cells = {name: cell for name, cell in cells.items() if name in _PLACES}
            if cells:
                _add(found, record, texts_of(record).get("target"), cells)
    if path is not None:
        for record in read_table(path).records:
            cells = {_ours(name): cell for name, cell in record.cells.items() if _ours(name) in _PLACES}
            fire = next((record.cells[name] for name in _NAMES if name in record.cells), None)
            _add(found, record, fire, cells)
    if not found.by_fire:
        first = f": {found.faults[0]}" if found.faults else ""
        raise SightingsError(
            "no fire has a known ignition: give --ignitions FILE with the columns fire, lat, lon, "
            f"or ignition_lat and ignition_lon beside each sighting{first}"
        )
    return found


def fires_of(
    sightings: Sequence[Sighting], where: Sequence[str], known: Ignitions
) -> tuple[list[KnownFire], list[str]]:
    """The fires in the order of their names, and what is said of sightings and ignitions that find no other."""
    groups: dict[str, list[Sighting]] = {}
    lines: list[str] = []
    nameless = [row for one, row in zip(sightings, where, strict=True) if one.target is None]
    if nameless:
        lines.append(f"{len(nameless)} sightings without a fire, the first is {nameless[0]}: not used")
    for one in sightings:
        if one.target is not None:
            groups.setdefault(one.target, []).append(one)
    for name in sorted(known.by_fire.keys() - groups.keys()):
        lines.append(f"fire {name!r}: an ignition and no sightings")
    unknown = sorted(groups.keys() - known.by_fire.keys())
    if unknown:
        more = ", ..." * (len(unknown) > _MOST_LISTED)
        lines.append(f"fires without a known ignition, not scored: {', '.join(unknown[:_MOST_LISTED])}{more}")
    fires = []
    for name in sorted(groups.keys() & known.by_fire.keys()):
        ignition = known.by_fire[name]
        camera = groups[name][0]
        wrong = far_apart([(ignition.lat_deg, ignition.lon_deg)], (camera.lat_deg, camera.lon_deg))
        if wrong:
            says = wrong[0].replace("home is", "its first camera is")
            lines.append(f"fire {name!r}: its ignition's {says}: not scored")
            continue
        fires.append(KnownFire(name, tuple(groups[name]), ignition))
    return fires, lines


def _ours(name: str) -> str:
    """`lat` and `lon`, however they are called here."""
    return next((ours for ours, names in _PLACES.items() if name in names), name)


def _add(found: Ignitions, record: Record, fire: str | None, cells: dict[str, str]) -> None:
    try:
        if fire is None:
            raise RowError("has an ignition and no fire's name: a column fire")
        numbers = numbers_of(Record(record.where, cells))
        if "lat" not in numbers or "lon" not in numbers:
            raise RowError("has no place of the ignition: lat and lon, in degrees")
        found.add(record.where, fire, Ignition(numbers["lat"], numbers["lon"], _sigma_m(record)))
    except RowError as error:
        found.faults.append(f"{record.where}: {error}")


def _sigma_m(record: Record) -> float:
    cell = next((record.cells[name] for name in _SIGMAS if name in record.cells), None)
    if cell is None:
        return 0.0
    try:
        value = float(cell)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= _MOST_SIGMA_M:
        raise RowError(f"ignition_sigma_m {cell!r}: must be metres, 0 to {_MOST_SIGMA_M:g}")
    return value
