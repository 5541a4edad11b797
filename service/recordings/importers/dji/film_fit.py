"""A subtitle file's cues on its film's clock: which film it is, whether it fits, and how fast it plays."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.dji.cues import Cue
from service.recordings.importers.dji.words import Words
from service.recordings.importers.film import film_of
from service.recordings.importers.flight import Film, ImportRefusedError, Remarks

_SUFFIXES = (".MP4", ".mp4", ".MOV", ".mov", ".LRF", ".lrf")
_MOST_DIFFERENCE_S, _MOST_SHARE = 2.0, 0.05  # between a film's length and its cues'
_PER_FRAME = 1.5  # a cue that lasts less than so many frames is a frame's
_LEAST_CHECKED_S = 5.0
_PLAYED_AS_TAKEN = (0.95, 1.05)
_MOST_RATIO = 1000.0  # a hyperlapse's


@dataclass(frozen=True)
class Fitted:
    """Times (N,) of the cues; the film's frames on the same clock and its size, None without one."""

    time_s: FloatArray
    film: Film | None
    size: tuple[int, int] | None


def film_beside(path: Path, films: Sequence[Path]) -> Path | None:
    """The film of the same name, the only one that was named, or the one that lies beside it."""
    named = [film for film in films if film.stem.lower() == path.stem.lower()]
    if named or len(films) == 1:
        return (named or list(films))[0]
    return next((film for suffix in _SUFFIXES if (film := path.with_suffix(suffix)).is_file()), None)


def on_film(path: Path, cues: Sequence[Cue], rows: Sequence[Words], film: Path | None, remarks: Remarks) -> Fitted:
    """The cues' times, by the film's own stamps where a cue is a frame's; ImportRefusedError where they do not fit."""
    start_s = np.array([cue.start_s for cue in cues])
    ratio = _played(start_s, rows, remarks)
    if film is None:
        remarks.lacks.append(f"the film: none is named, none lies beside it as {path.stem}.MP4")
        return Fitted(start_s * ratio, None, None)
    if film.stem.lower() != path.stem.lower():
        remarks.doubt.append(f"{film.name} has another name than {path.name}: are these its subtitles?")
    lens, frames, said = film_of(film)
    remarks.found.extend(said.found)
    _check_length(path, film, cues, frames.time_s)
    time_s = _frame_times(start_s, rows, frames.time_s, remarks)
    return Fitted(time_s * ratio, Film(film, frames.time_s * ratio), (lens.width, lens.height))


def _check_length(path: Path, film: Path, cues: Sequence[Cue], frame_s: FloatArray) -> None:
    step_s = float(np.median(np.diff(frame_s))) if len(frame_s) > 1 else 0.0
    film_s, told_s = float(frame_s[-1]) + step_s, max(cues[-1].end_s, cues[-1].start_s)
    if abs(film_s - told_s) > max(_MOST_DIFFERENCE_S, _MOST_SHARE * film_s):
        raise ImportRefusedError(
            f"{path}: tells {told_s:.1f} s in {len(cues)} cues and {film.name} has {film_s:.1f} s in {len(frame_s)} "
            "frames: it is another film's"
        )


def _frame_times(start_s: FloatArray, rows: Sequence[Words], frame_s: FloatArray, remarks: Remarks) -> FloatArray:
    """Of cues that are frames', by their number, the frame's own stamp: a cue's start is cut to milliseconds."""
    counts = np.array([one.count or 0 for one in rows])
    if len(start_s) < 2 or len(frame_s) < 2 or (counts < 1).any() or (np.diff(counts) < 1).any():
        return start_s
    frame_step_s = float(np.median(np.diff(frame_s)))
    if float(np.median(np.diff(start_s))) > _PER_FRAME * frame_step_s:
        return start_s
    first = counts - counts[0] + round(float(start_s[0]) / frame_step_s)
    is_inside = first < len(frame_s)
    stamps = frame_s[np.minimum(first, len(frame_s) - 1)]
    off_s = float(np.abs(stamps - start_s)[is_inside].max(initial=0.0))
    if off_s > 2.0 * frame_step_s:
        remarks.assumed.append(f"cues are tied to the film by their times: by their numbers they are {off_s:.2f} s off")
        return start_s
    return np.where(is_inside, stamps, start_s)


def _played(start_s: FloatArray, rows: Sequence[Words], remarks: Remarks) -> float:
    """Seconds of flight in a second of film, by the cues' dates: more than one of a hyperlapse, less in slow motion."""
    dated = [(t, one.local_s) for t, one in zip(start_s.tolist(), rows, strict=True) if one.local_s is not None]
    if len(dated) < 3 or dated[-1][0] - dated[0][0] < _LEAST_CHECKED_S:
        return 1.0
    film_s, local_s = np.array(dated).T
    slope = float(
        np.median(np.diff(local_s[:: max(1, len(dated) // 20)]) / np.diff(film_s[:: max(1, len(dated) // 20)]))
    )
    whole = float((local_s[-1] - local_s[0]) / (film_s[-1] - film_s[0]))
    is_even = abs(slope - whole) <= 0.1 * abs(slope)
    if not is_even or _PLAYED_AS_TAKEN[0] <= slope <= _PLAYED_AS_TAKEN[1] or not 0.0 < slope < _MOST_RATIO:
        if not is_even:
            remarks.assumed.append("the cues' dates do not run evenly: the film's own time is used")
        return 1.0
    remarks.assumed.append(
        f"a second of film is {whole:.3g} s of flight, by the cues' dates: it was not played as taken"
    )
    return whole
