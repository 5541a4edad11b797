"""What `distloc locate` does: read, locate, print, write."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from distloc.batch.locate import Each, locate
from distloc.batch.place import Located
from distloc.study.runner import run_all
from service.commands.locate import words
from service.commands.locate.writing import write_all
from service.commands.progress import count_progress
from service.commands.study.files import prepared
from service.recordings.sightings.reading import SightingsError
from service.recordings.sightings.rows import Sightings
from service.recordings.sightings.wanted import Wanted, ground_of, read_sightings

_MANY = 1500  # sightings, from which on processes are worth their start
_MANY_TARGETS = 8

T = TypeVar("T")
R = TypeVar("R")


def run_locate(
    paths: list[Path], wanted: Wanted, say: Callable[[str], None], warn: Callable[[str], None], jobs: int = 1
) -> Located:
    """Print the places and write the files that are asked for; SightingsError where no row can be used."""
    if wanted.out:
        prepared(wanted.out)
    _, found = read_sightings(paths, wanted, warn)
    ground = ground_of(wanted, found, warn)
    with count_progress("sightings", len(found.sightings)) as on_done:
        each = _in_processes(jobs if _is_much(found) else 1)
        located = locate(found.sightings, ground=ground, range_m=wanted.range_m, on_done=on_done, each=each)
    height_name = "over the ellipsoid" if found.is_ellipsoidal else "MSL"
    for line in [*words.table(located, height_name), *words.notes(located, found.where)]:
        say(line)
    if wanted.out:
        _write(wanted.out, located, found, say)
    if not located.places:
        raise SightingsError(f"{paths[0]}: no place: {words.why(located.rejected[0], found.where)}")
    return located


def _is_much(found: Sightings) -> bool:
    return len(found.sightings) >= _MANY and len({one.target for one in found.sightings}) >= _MANY_TARGETS


def _in_processes(jobs: int) -> Each:
    def each(function: Callable[[T], R], tasks: Sequence[T], /, *, on_done: Callable[[int], None]) -> Iterable[R]:
        return run_all(function, tasks, jobs, on_done)

    return each


def _write(out: Path, located: Located, found: Sightings, say: Callable[[str], None]) -> None:
    names = write_all(out, located, found.sightings, found.where, found.is_ellipsoidal)
    try:
        from service.commands.locate.draw import draw_map

        draw_map(out / "map.png", located, found.sightings)
        names.append("map.png")
    except ModuleNotFoundError as error:
        if error.name is None or not error.name.startswith("matplotlib"):
            raise
        say("no map.png: matplotlib is not installed: pip install '.[study]'")
    say(f"wrote {out}/{', '.join(names)}")
