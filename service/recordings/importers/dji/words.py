"""What one cue says, in whichever dialect: names with values in brackets, or functions with values in parentheses.

Nothing is judged here: which of two numbers is the latitude, and in what unit an angle is, the whole file tells.
"""

import math
import re
from calendar import timegm
from dataclasses import dataclass, field

_NUMBER = r"[-+]?\d{1,12}(?:\.\d{1,12})?"
_EITHER = r"[-+]?\d{1,12}(?:[.,]\d{1,12})?"  # with a decimal comma, too
_TAG = re.compile(r"<[^<>]{0,200}>")
_BRACKET = re.compile(r"\[([^\[\]]{1,400})\]")
_LABEL = re.compile(r"^\s*(drone|aircraft|gimbal|camera)\s*:\s*(?=[a-z])", re.IGNORECASE)
_PAIR = re.compile(rf"([a-z][a-z_]{{0,30}})\s*:\s*({_EITHER})(?![\d/])", re.IGNORECASE)
_FUNCTION = re.compile(r"(?<![\w.])(GPS|RTK|HOME|F\.PRY|G\.PRY)\s*\(([^()]{1,120})\)", re.IGNORECASE)
_PART = re.compile(rf"^\s*([NSEW])?\s*:?\s*({_NUMBER})\s*(°|º|Â°|\ufffd{1, 2}|m)?\s*$", re.IGNORECASE)
_BAROMETER = re.compile(rf"\bBAROMETER\s*:\s*({_EITHER})\s*M?\b", re.IGNORECASE)
_MEASURE = re.compile(rf"(?<![\w.])(D|H|H\.S|DZOOM)\s*[ =:]\s*({_NUMBER})", re.IGNORECASE)
_COUNT = re.compile(r"\b(?:SrtCnt|FrameCnt)\s*:\s*(\d{1,9})", re.IGNORECASE)
_DATE = re.compile(
    r"(?<!\d)(\d{4})[-./](\d{1,2})[-./](\d{1,2})[ T]{1,3}(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d{1,3}))?(?:[.,](\d{3}))?"
)
_KEYS = {
    "lat": "latitude",
    "lon": "longitude",
    "lng": "longitude",
    "longtitude": "longitude",  # as much of DJI's firmware spells it
    "dzoom": "dzoom_ratio",
    "gimbal_yaw": "gb_yaw",
    "gimbal_pitch": "gb_pitch",
    "gimbal_roll": "gb_roll",
    "camera_yaw": "gb_yaw",
    "camera_pitch": "gb_pitch",
    "camera_roll": "gb_roll",
    "aircraft_yaw": "drone_yaw",
    "aircraft_pitch": "drone_pitch",
    "aircraft_roll": "drone_roll",
}
_WANTED = frozenset(
    {
        *("latitude", "longitude", "rel_alt", "abs_alt", "altitude", "focal_len", "dzoom_ratio"),
        *("gb_yaw", "gb_pitch", "gb_roll", "drone_yaw", "drone_pitch", "drone_roll"),
    }
)


@dataclass(frozen=True, slots=True)
class Tuple3:
    """Up to three numbers of a function with their texts; `axes` are the letters N, S, E, W where it has them."""

    values: tuple[float, ...]
    texts: tuple[str, ...]
    axes: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Words:
    """`keyed` by our names, each with its text; `local_s` is the craft's own date and time as if it were UTC's."""

    keyed: dict[str, str] = field(default_factory=dict)
    functions: dict[str, Tuple3] = field(default_factory=dict)
    count: int | None = None
    local_s: float | None = None

    def number(self, name: str) -> float:
        """The value of a name, NaN where it is not there."""
        return number_of(self.keyed.get(name))


def words_of(text: str) -> Words:
    """All that a cue's text says."""
    text = " ".join(_TAG.sub(" ", text).split())  # long blanks would be tried over and over
    keyed: dict[str, str] = {}
    for group in _BRACKET.findall(text):
        label = _LABEL.match(group)
        prefix = "" if label is None else f"{label.group(1).lower()}_"
        for written, value in _PAIR.findall(group):
            name = prefix + written.lower()
            name = _KEYS.get(name, name)
            if name in _WANTED:
                keyed.setdefault(name, value)
    for name, value in _MEASURE.findall(text):
        keyed.setdefault({"D": "distance", "H": "height", "H.S": "speed"}.get(name.upper(), "dzoom_ratio"), value)
    if found := _BAROMETER.search(text):
        keyed.setdefault("barometer", found.group(1))
    functions: dict[str, Tuple3] = {}
    for name, inner in _FUNCTION.findall(text):
        if (numbers := _numbers(inner)) is not None:
            functions.setdefault("GPS" if name.upper() == "RTK" else name.upper(), numbers)
    count = _COUNT.search(text)
    return Words(keyed, functions, int(count.group(1)) if count else None, _local_s(text))


def number_of(text: str | None) -> float:
    """A number with a decimal point or comma; NaN where there is none."""
    try:
        return float(text.replace(",", ".")) if text else math.nan
    except ValueError:
        return math.nan


def _numbers(inner: str) -> Tuple3 | None:
    """The parts of `149.02, -20.25, 16`; of `149,02, -20,25, 16` and `149,02;-20,25;16` as well."""
    if ";" in inner:
        parts = inner.replace(",", ".").split(";")
    elif "." in inner or inner.count(",") < 3:
        parts = inner.split(",")
    else:  # decimal commas
        cells = inner.split(",")
        parts = [f"{whole}.{fraction}" for whole, fraction in zip(cells[::2], cells[1::2], strict=False)]
        parts += cells[-1:] if len(cells) % 2 else []
    found = [_PART.match(part) for part in parts[:3]]
    if len(found) < 2 or any(one is None for one in found):
        return None
    texts = tuple(one.group(2) for one in found if one)
    axes = tuple((one.group(1) or "").upper() for one in found if one)
    units = tuple((one.group(3) or "").lower() for one in found if one)
    return Tuple3(tuple(float(one) for one in texts), texts, axes, units)


def _local_s(text: str) -> float | None:
    found = _DATE.search(text)
    if found is None:
        return None
    year, month, day, hour, minute, second = (int(one) for one in found.groups()[:6])
    if not (1990 <= year < 2200 and 1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and minute < 60 and second < 61):
        return None
    fraction = float(f"0.{found.group(7) or 0}") + float(f"0.000{found.group(8) or 0}")
    return timegm((year, month, day, hour, minute, second)) + fraction
