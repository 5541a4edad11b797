"""A subtitle file's cues, one at a time; a stranger may have made it."""

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from service.recordings.importers.flight import ImportRefusedError

MOST_CUES = 500_000  # 4.6 hours at 30 a second
_MOST_TEXT = 16_384  # of a cue; a Phantom's debugging cue has 3,000 characters
_LONGEST_LINE = 8_192
_MOST_BYTES = 500_000_000  # hours at 60 cues a second
_CLOCK = r"(\d{1,3}):(\d{1,2}):(\d{1,2})(?:[,.](\d{1,3}))?"
_TIMES = re.compile(rf"^\s*{_CLOCK}\s*-->\s*{_CLOCK}")


@dataclass(frozen=True, slots=True)
class Cue:
    """What is shown from `start_s` to `end_s` of the film."""

    start_s: float
    end_s: float
    text: str


def cues_of(path: Path) -> Iterator[Cue]:
    """Cues in the file's order; ImportRefusedError where it cannot be read or has too many.

    A cue begins at its line of times and ends at the next one: some have empty lines inside. Its own number, and the
    next one's at its end, are left to the reader of the words, which do not look like one.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ImportRefusedError(f"{path}: has more than {_MOST_BYTES} bytes: no subtitle file is so large")
        with path.open(encoding=_encoding(path), errors="replace") as file:
            yield from _cues(path, file)
    except OSError as error:
        raise ImportRefusedError(f"{path}: cannot be read: {error.strerror}") from error


def looks_like_cues(head: bytes) -> bool:
    """Whether a file's first bytes hold a line of times."""
    text = head[:4096].decode(
        "utf-16" if head[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-8", "replace"
    )
    return any(_TIMES.match(line) for line in text.splitlines()[:20])


def _encoding(path: Path) -> str:
    with path.open("rb") as file:
        head = file.read(2)
    return "utf-16" if head in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else "utf-8-sig"


def _cues(path: Path, file: TextIO) -> Iterator[Cue]:
    times: tuple[float, float] | None = None
    parts: list[str] = []
    size = number = 0
    while line := file.readline(_LONGEST_LINE):
        if (found := _TIMES.match(line)) is None:
            if times is not None and size < _MOST_TEXT:
                parts.append(line)
                size += len(line)
            continue
        if times is not None:
            yield Cue(*times, "".join(parts)[:_MOST_TEXT])
        number += 1
        if number > MOST_CUES:
            raise ImportRefusedError(f"{path}: more than {MOST_CUES} cues: cut it, with its film")
        groups = found.groups()
        times, parts, size = (_seconds(groups[:4]), _seconds(groups[4:])), [], 0
    if times is not None:
        yield Cue(*times, "".join(parts)[:_MOST_TEXT])


def _seconds(groups: tuple[str | None, ...]) -> float:
    hours, minutes, seconds, fraction = groups
    return int(hours or 0) * 3600 + int(minutes or 0) * 60 + int(seconds or 0) + float(f"0.{fraction or 0}")
