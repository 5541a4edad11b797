"""An XMP packet's properties by the names that its writer gave them; a stranger may have made it.

Expat without its namespaces: some drones leave out what their prefixes mean, and the prefixes are always the same.
"""

import contextlib
from xml.parsers import expat

MOST_BYTES = 2_000_000
_MOST_DEPTH, _MOST_VALUES, _LONGEST = 32, 5_000, 1_000
_RDF = ("rdf:RDF", "rdf:Description", "rdf:Bag", "rdf:Seq", "rdf:Alt", "rdf:li", "x:xmpmeta", "x:xapmeta")


class _RefusedError(Exception):
    """What no picture's XMP needs: entities and document types, too deep or too many values."""


def properties_of(packet: bytes) -> dict[str, str]:
    """Values by `prefix:Name`, of a structure's parts by `prefix:Structure:Name`; attributes and elements alike.

    What a packet breaks off with, or what follows something that is refused, is left out.
    """
    found: dict[str, str] = {}
    path: list[str] = []
    texts: list[str] = []

    def put(name: str, value: str) -> None:
        if len(found) >= _MOST_VALUES:
            raise _RefusedError
        if value.strip():
            found.setdefault(name, value.strip()[:_LONGEST])

    def start(name: str, attributes: dict[str, str]) -> None:
        if len(path) >= _MOST_DEPTH:
            raise _RefusedError
        path.append(name)
        texts.append("")
        for key, value in attributes.items():
            if ":" in key and not key.startswith(("xmlns:", "rdf:", "x:", "xml:")):
                put(_named([*path, key]), value)

    def end(_name: str) -> None:
        text = texts.pop()
        if path[-1] not in _RDF:
            put(_named(path), text)
        path.pop()

    def characters(text: str) -> None:
        if texts and len(texts[-1]) < _LONGEST:
            texts[-1] += text[:_LONGEST]

    def refuse(*_: object) -> int:
        raise _RefusedError

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = parser.ExternalEntityRefHandler = refuse  # no entity is declared without it
    with contextlib.suppress(expat.ExpatError, _RefusedError, UnicodeError):
        parser.Parse(packet[:MOST_BYTES].strip(b"\0 \r\n\t"), True)
    return found


def _named(path: list[str]) -> str:
    """The innermost structure and its part; a part's prefix is its structure's."""
    names = [name for name in path if name not in _RDF]
    if len(names) < 2:
        return names[-1] if names else ""
    return f"{names[-2]}:{names[-1].rpartition(':')[2]}"
