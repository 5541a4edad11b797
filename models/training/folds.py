"""Which frames hold each other's secrets: what shares a day or a camera is scored by a network that saw none of it."""

import re
from collections.abc import Sequence

_DAY = re.compile(r"(?:19|20)\d{6}(?=_)")  # as HPWREN's names begin
_SENSOR = re.compile(r"-(?:mobo-[cm]|mobo|mono)$")  # in colour or without: the same mast, the same view
_NUMBERED = re.compile(r"_frame|-converted")  # where a clip's name ends and its frame's number begins


def event_of(stem: str) -> str:
    """What a frame shares with others: the day of a dated name, else its clip.

    Cameras side by side see one fire, in colour and without, and sets of frames overlap: a day is one event in all.
    """
    day = _DAY.match(stem)
    return day[0] if day else _NUMBERED.split(stem)[0]


def camera_of(stem: str) -> str:
    """The camera of a name as HPWREN writes it, `DAY_FIRE_CAMERA__...`; empty for any other."""
    if not (_DAY.match(stem) and "__" in stem):
        return ""
    return _SENSOR.sub("", stem.split("__", maxsplit=1)[0].rsplit("_", 1)[-1])


def scenes(stems: Sequence[str]) -> list[int]:
    """A number for each name, the same for names that are joined by an event or a camera, however many steps away."""
    root: dict[str, str] = {}

    def top(key: str) -> str:
        while root.setdefault(key, key) != key:
            key = root[key]
        return key

    for stem in stems:
        if camera := camera_of(stem):
            root[top(f"camera {camera}")] = top(event_of(stem))
    tops = [top(event_of(stem)) for stem in stems]
    order = {one: number for number, one in enumerate(sorted(set(tops)))}
    return [order[one] for one in tops]


def kin(stems: Sequence[str], of: Sequence[str]) -> list[bool]:
    """Whether each name shares an event or a camera with one of the others."""
    events, cameras = {event_of(one) for one in of}, {camera_of(one) for one in of} - {""}
    return [event_of(one) in events or camera_of(one) in cameras for one in stems]


def folds(stems: Sequence[str], has_smoke: Sequence[bool], validation: Sequence[str], count: int) -> list[int]:
    """Each frame's fold from 0; 0 has the scenes of the `validation` events, which no other fold's network sees.

    Scenes with smoke go to the fold from 1 to `count` that has the fewest frames, the largest scene first. Of those
    without each third is validation's, whatever `count` is. With a `count` of 0 what is not validation is fold 1.
    """
    scene, count = scenes(stems), max(1, count)
    members = {number: [i for i, one in enumerate(scene) if one == number] for number in sorted(set(scene))}
    held = {one for one, stem in zip(scene, stems, strict=True) if event_of(stem) in set(validation)}
    fold_of = dict.fromkeys(held, 0)
    filled = [0] * count
    by_size = sorted(set(members) - held, key=lambda number: (-len(members[number]), number))
    for number in (one for one in by_size if any(has_smoke[i] for i in members[one])):
        fold = min(range(count), key=filled.__getitem__)
        filled[fold] += len(members[number])
        fold_of[number] = fold + 1
    for place, number in enumerate(one for one in by_size if one not in fold_of):
        third, rest = divmod(place, 3)
        fold_of[number] = 0 if rest == 0 else 1 + (place - third - 1) % count
    return [fold_of[one] for one in scene]
