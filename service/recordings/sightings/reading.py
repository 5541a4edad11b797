"""Tables of sightings as files: CSV with any usual separator, and GeoJSON points. `sightings` reads their meaning."""

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service.common.files import FileRefusedError, check_file

MOST_BYTES = 200_000_000
_SEPARATORS = (";", "\t", ",", "|")
_JSON_SUFFIXES = frozenset({".json", ".geojson"})


class SightingsError(Exception):
    """A table that can't be used: one line that says which, why and what would be right."""


@dataclass(frozen=True, slots=True)
class Record:
    """One row: its cells by column, stripped, without the empty ones. `where` names file and row."""

    where: str
    cells: dict[str, str]


@dataclass(frozen=True, slots=True)
class Table:
    """A file's rows and its columns, as its header names them, in lower case."""

    path: Path
    columns: tuple[str, ...]
    records: tuple[Record, ...]


def read_table(path: Path, rows: str = "sightings", most_bytes: int = MOST_BYTES) -> Table:
    """A file's rows; SightingsError where it holds none. `rows` says what they are."""
    try:
        check_file(path, most_bytes=most_bytes)
        data = path.read_bytes()
    except FileRefusedError as error:
        raise SightingsError(str(error)) from error
    except OSError as error:
        raise SightingsError(f"{path}: cannot be read: {error.strerror}") from error
    text = _decoded(path, data)
    is_json = path.suffix.lower() in _JSON_SUFFIXES or text.lstrip().startswith("{")
    table = _geojson(path, text) if is_json else _csv(path, text)
    if not table.records:
        raise SightingsError(f"{path}: holds no {rows}: a header with one row for each is expected")
    return table


def _decoded(path: Path, data: bytes) -> str:
    """UTF-8 with or without its mark, or UTF-16 with one, as spreadsheets write it."""
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise SightingsError(f"{path}: is no text in UTF-8: save it as CSV in UTF-8") from error
    if "\0" in text:
        raise SightingsError(f"{path}: is no text: CSV or GeoJSON is read")
    return text


def _csv(path: Path, text: str) -> Table:
    lines = text.splitlines()
    first = next((number for number, line in enumerate(lines) if line.strip()), None)
    if first is None:
        raise SightingsError(f"{path}: is empty")
    separator = max(_SEPARATORS, key=lambda one: (lines[first].count(one), -_SEPARATORS.index(one)))
    reader = csv.reader(lines[first:], delimiter=separator, skipinitialspace=True)
    try:
        header = [name.strip().lower() for name in next(reader)]
        records = list(_rows(path, reader, header, first, separator))
    except csv.Error as error:
        raise SightingsError(f"{path}: row {first + reader.line_num}: {error}") from error
    twice = next((name for name in header if name and header.count(name) > 1), None)
    if twice is not None:
        raise SightingsError(f"{path}: has two columns {twice!r}: each must have a name of its own")
    return Table(path, tuple(header), tuple(records))


def _rows(path: Path, reader: Any, header: list[str], skipped: int, separator: str) -> Iterator[Record]:
    for row in reader:
        cells = {name: cell.strip() for name, cell in zip(header, row, strict=False) if cell.strip()}
        if separator != ",":  # then commas may be decimal points
            cells = {name: _with_point(cell) for name, cell in cells.items()}
        if cells:
            yield Record(f"{path.name} row {skipped + reader.line_num}", cells)


def _with_point(cell: str) -> str:
    pointed = cell.replace(",", ".")
    return pointed if cell.count(",") == 1 and pointed.lstrip("+-").replace(".", "", 1).isdigit() else cell


def _geojson(path: Path, text: str) -> Table:
    try:
        content = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise SightingsError(f"{path}: is no JSON: {error}") from error
    features = content.get("features") if isinstance(content, dict) else None
    if not isinstance(features, list):
        raise SightingsError(f"{path}: is no GeoJSON FeatureCollection: it lacks a list `features`")
    records = [Record(f"{path.name} feature {number}", _cells(one)) for number, one in enumerate(features, 1)]
    columns = dict.fromkeys(name for record in records for name in record.cells)
    return Table(path, tuple(columns), tuple(records))


def _cells(feature: Any) -> dict[str, str]:
    """Properties, and the point's coordinates as lon, lat and, with a third one, alt_ellipsoidal_m."""
    feature = feature if isinstance(feature, dict) else {}
    properties, geometry = feature.get("properties"), feature.get("geometry")
    cells = {
        str(name).strip().lower(): str(value)
        for name, value in (properties.items() if isinstance(properties, dict) else ())
        if value is not None and not isinstance(value, dict | list)
    }
    if isinstance(geometry, dict) and geometry.get("type") == "Point" and isinstance(geometry.get("coordinates"), list):
        names = ["lon", "lat"]
        if not any(name.startswith("alt") for name in cells):
            names.append("alt_ellipsoidal_m")
        cells |= {name: str(value) for name, value in zip(names, geometry["coordinates"], strict=False)}
    return cells
