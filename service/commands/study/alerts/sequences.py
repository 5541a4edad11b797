"""Folders of frames as fixed cameras' sequences by the frames' names, with what their folders tell of the smoke."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from distloc.study.alerts.names import FrameName, frame_name
from service.commands.study.images import ImageFolder, ImageFolderError, LabelledImage, labelled_images

_ONE_IGNITION_S = 600  # what the times of one ignition's frames may differ by
_Named = tuple[FrameName, ImageFolder, Path]


@dataclass(frozen=True, slots=True)
class CameraSequence:
    """A fixed camera's frames by time, each with its folder."""

    name: str
    frames: tuple[_Named, ...]


def camera_sequences(folders: Sequence[ImageFolder], say: Callable[[str], None]) -> list[CameraSequence]:
    """The folders' frames by camera and ignition, in order of time; one sequence may lie in several folders."""
    found: dict[tuple[str, int], dict[int, _Named]] = {}
    for folder in folders:
        nameless = 0
        for path in folder.images:
            named = frame_name(path.stem)
            if named is None:
                nameless += 1
                continue
            frames = found.setdefault(_sequence_of(named, folder.name, found), {})
            if named.since_ignition_s in frames:
                say(f"{path}: another frame is of the same time; left out")
            frames.setdefault(named.since_ignition_s, (named, folder, path))
        if nameless == len(folder.images):
            raise ImageFolderError(
                f"{folder.images[0]}: its name tells no time from the ignition on: it must end in UNIX_+SECONDS, as "
                "camera__1465065660_+00060.jpg"
            )
        if nameless:
            say(f"{folder.name}: {nameless} images whose names tell no time from the ignition on; left out")
    whole = [CameraSequence(_title(key, found), _in_order(frames)) for key, frames in found.items() if len(frames) > 1]
    single = len(found) - len(whole)
    if not whole:
        raise ImageFolderError(f"{folders[0].name}: no sequence: each of the {single} has a single frame")
    if single:
        say(f"{single} sequences of a single frame; left out")
    return sorted(whole, key=lambda one: one.name)


def labelled_frames(
    sequence: CameraSequence, say: Callable[[str], None]
) -> Iterator[tuple[LabelledImage, FrameName, bool]]:
    """Each frame that can be read, and whether its folder says where the smoke is."""
    for named, folder, path in sequence.frames:
        has_truth = folder.masks is not None or bool(folder.boxes)
        for _, labelled in labelled_images(replace(folder, images=(path,)), say):
            if labelled is not None:
                yield labelled, named, has_truth


def _sequence_of(named: FrameName, folder: str, known: Iterable[tuple[str, int]]) -> tuple[str, int]:
    """The camera's name and its ignition; times that differ by little are of one."""
    name, ignition_s = named.sequence or folder, named.unix_s - named.since_ignition_s
    return next(
        (one for one in known if one[0] == name and abs(one[1] - ignition_s) <= _ONE_IGNITION_S), (name, ignition_s)
    )


def _title(key: tuple[str, int], known: Iterable[tuple[str, int]]) -> str:
    return key[0] if sum(one[0] == key[0] for one in known) == 1 else f"{key[0]}__{key[1]}"


def _in_order(frames: Mapping[int, _Named]) -> tuple[_Named, ...]:
    return tuple(frames[at] for at in sorted(frames))
