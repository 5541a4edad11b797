"""Folders of frames as fixed cameras' sequences by the frames' names, with what their folders tell of the smoke."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from distloc.study.alerts.names import FrameName, frame_name
from service.commands.study.images import ImageFolder, ImageFolderError, LabelledImage, labelled_images


@dataclass(frozen=True, slots=True)
class CameraSequence:
    """A fixed camera's frames by time, each with its folder."""

    name: str
    frames: tuple[tuple[FrameName, ImageFolder, Path], ...]


def camera_sequences(folders: Sequence[ImageFolder], say: Callable[[str], None]) -> list[CameraSequence]:
    """The folders' frames by their names, in order of time; one may lie in several folders."""
    found: dict[str, dict[int, tuple[FrameName, ImageFolder, Path]]] = {}
    for folder in folders:
        nameless = 0
        for path in folder.images:
            named = frame_name(path.stem)
            if named is None:
                nameless += 1
                continue
            frames = found.setdefault(named.sequence or folder.name, {})
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
    whole = {name: [frames[at] for at in sorted(frames)] for name, frames in sorted(found.items()) if len(frames) > 1}
    single = len(found) - len(whole)
    if not whole:
        raise ImageFolderError(f"{folders[0].name}: no sequence: each of the {single} has a single frame")
    if single:
        say(f"{single} sequences of a single frame; left out")
    return [CameraSequence(name, tuple(frames)) for name, frames in whole.items()]


def labelled_frames(
    sequence: CameraSequence, say: Callable[[str], None]
) -> Iterator[tuple[LabelledImage, FrameName, bool]]:
    """Each frame that can be read, and whether its folder says where the smoke is."""
    for named, folder, path in sequence.frames:
        has_truth = folder.masks is not None or bool(folder.boxes)
        for _, labelled in labelled_images(replace(folder, images=(path,)), say):
            if labelled is not None:
                yield labelled, named, has_truth
