"""GPMF, GoPro's metadata format: the streams of one payload as scaled numbers. Free of I/O.

By the format's public description (github.com/gopro/gpmf-parser): big-endian elements of a four-letter key, a type, a
sample's size and a count, padded to 4 bytes; in a STRM the last element is the data, those before it say how to read
it.
"""

import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray

_MOST_DEPTH, _MOST_ELEMENTS = 6, 20_000
_NESTED, _COMPLEX = 0, ord("?")
_DTYPES = {
    **{"b": ">i1", "B": ">u1", "s": ">i2", "S": ">u2", "l": ">i4", "L": ">u4", "j": ">i8", "J": ">u8"},
    **{"f": ">f4", "d": ">f8", "q": ">i4", "Q": ">i8"},
}
_FIXED_POINT = {"q": 2.0**-16, "Q": 2.0**-32}
_TEXT = frozenset("cFU")
_MOST_FIELDS = 256
_MOST = 1e18  # beyond is not a number: squares and sums of it would not be one either
_TYPE_PART = re.compile(r"([A-Za-z])(?:\[(\d{1,3})\])?")


@dataclass(frozen=True)
class Stream:
    """One stream's samples in a payload: `values` (n, m), scaled; `notes` are the elements before them, by key.

    A note is text, or numbers (k, m).
    """

    device: str
    device_id: int
    key: str
    values: FloatArray
    notes: dict[str, str | FloatArray]

    def number(self, key: str) -> float | None:
        """A note's first number; None where there is none."""
        note = self.notes.get(key)
        return float(note.flat[0]) if isinstance(note, np.ndarray) and note.size else None

    def text(self, key: str) -> str:
        """A note's text, empty where there is none."""
        note = self.notes.get(key)
        return note if isinstance(note, str) else ""


@dataclass(frozen=True, slots=True)
class _Element:
    key: str
    kind: int
    size: int
    count: int
    data: bytes


def streams_of(payload: bytes) -> list[Stream]:
    """What can be read of a payload; an element that reaches beyond its own ends what it stands in. Never raises."""
    out: list[Stream] = []
    budget = [_MOST_ELEMENTS]
    for device in _elements(payload, budget):
        if device.key != "DEVC" or device.kind != _NESTED:
            continue
        name, number = "", 0
        for element in _elements(device.data, budget):
            if element.key == "DVNM":
                name = _text(element)
            elif element.key == "DVID":
                number = int.from_bytes(element.data[:4], "big")
            elif element.key == "STRM" and element.kind == _NESTED:
                out.extend(_streams(element.data, name, number, budget, 2))
    return out


def _streams(data: bytes, device: str, device_id: int, budget: list[int], depth: int) -> list[Stream]:
    notes: dict[str, str | FloatArray] = {}
    found: list[Stream] = []
    elements = _elements(data, budget)
    for number, element in enumerate(elements):
        if element.kind == _NESTED:
            if depth < _MOST_DEPTH:
                found += _streams(element.data, device, device_id, budget, depth + 1)
            continue
        is_last = number == len(elements) - 1
        if chr(element.kind) in _TEXT and not (is_last and element.kind == ord("U")):
            notes[element.key] = _text(element)
            continue
        values = _values(element, notes)
        if values is None:
            continue
        if is_last:
            scaled = _scaled(values, notes)
            with np.errstate(invalid="ignore"):
                finite = np.where(np.abs(scaled) < _MOST, scaled, np.nan)
            found.append(Stream(device, device_id, element.key, finite, notes))
        else:
            notes[element.key] = values
    return found


def _elements(data: bytes, budget: list[int]) -> list[_Element]:
    out: list[_Element] = []
    at = 0
    while at + 8 <= len(data) and budget[0] > 0:
        budget[0] -= 1
        key, kind, size, count = struct.unpack_from(">4sBBH", data, at)
        end = at + 8 + size * count
        if end > len(data) or key == b"\0\0\0\0":
            break
        out.append(_Element(key.decode("latin-1"), kind, size, count, data[at + 8 : end]))
        at += 8 + (size * count + 3) // 4 * 4
    return out


def _text(element: _Element) -> str:
    return element.data.split(b"\0")[0].decode("latin-1").strip()


def _values(element: _Element, notes: dict[str, Any]) -> FloatArray | None:
    """(n, m) as they stand; None for what is no number."""
    if element.count == 0 or element.size == 0:
        return None
    if element.kind == _COMPLEX:
        return _structures(element, notes.get("TYPE"))
    code = _DTYPES.get(chr(element.kind))
    if code is None or element.size % np.dtype(code).itemsize:
        return None
    raw = _doubles(np.frombuffer(element.data, dtype=code))
    return np.asarray(raw.reshape(element.count, -1) * _FIXED_POINT.get(chr(element.kind), 1.0))


def _structures(element: _Element, told: object) -> FloatArray | None:
    """Samples of unlike fields, as TYPE has them."""
    letters = _letters(told) if isinstance(told, str) else None
    if letters is None:
        return None
    fields = np.dtype([(f"f{i}", _DTYPES[letter]) for i, letter in enumerate(letters)])
    if fields.itemsize != element.size:
        return None
    rows = np.frombuffer(element.data, dtype=fields, count=element.count)
    columns = [_doubles(rows[f"f{i}"]) * _FIXED_POINT.get(letter, 1.0) for i, letter in enumerate(letters)]
    return np.stack(columns, axis=1)


def _doubles(values: NDArray[Any]) -> FloatArray:
    with np.errstate(invalid="ignore"):  # NaN that signals
        return values.astype(np.float64)


def _letters(told: str) -> str | None:
    """`"f[2]L"` is `"ffL"`; None for what holds anything but numbers."""
    out = ""
    for letter, times in _TYPE_PART.findall(told):
        if letter not in _DTYPES or len(out) + int(times or 1) > _MOST_FIELDS:
            return None
        out += letter * int(times or 1)
    return out or None


def _scaled(values: FloatArray, notes: dict[str, Any]) -> FloatArray:
    """Divided by SCAL: one number for all, or one for each column."""
    scale = notes.get("SCAL")
    if not isinstance(scale, np.ndarray):
        return values
    divisors = scale.ravel()
    if len(divisors) not in (1, values.shape[1]) or not (np.abs(divisors) > 1e-12).all():
        return values
    return values / divisors
