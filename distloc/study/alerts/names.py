"""What a frame's name says of it: whose sequence it is of, and when it was taken from the ignition on."""

import re
from dataclasses import dataclass

# HPWREN's FIgLib: 20160604_FIRE_rm-n-mobo-c__1465065660_+00060, or 1465065660_+00060 in a folder for each fire
_NAME = re.compile(r"(?P<sequence>.*?)_*(?P<unix_s>\d{9,10})_(?P<offset_s>[+-]\d{1,6})")


@dataclass(frozen=True, slots=True)
class FrameName:
    """`sequence` is empty where the name has no more than the times; seconds before the ignition are negative."""

    sequence: str
    unix_s: int
    since_ignition_s: int


def frame_name(stem: str) -> FrameName | None:
    """What a name without its suffix says; None where it has no UNIX_+SECONDS at its end."""
    found = _NAME.fullmatch(stem)
    return FrameName(found["sequence"], int(found["unix_s"]), int(found["offset_s"])) if found else None
