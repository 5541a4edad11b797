"""A report as it came, without what can't be: every form, the page and the fusion go by what is left.

Whoever is on the network can send one. What can't be is as what is not known: null.
"""

import msgspec

from service.publish.exchange.rings import LARGEST_M, known_ellipse
from service.publish.parts import EllipseReport, Number
from service.publish.wire import Report

_LEAST_ALTITUDE_M, _MOST_ALTITUDE_M = -1_000.0, 12_000.0


def judged(report: Report) -> Report:
    """The very report where all of it may be. Places are judged by whoever draws them, states by the wire's types."""
    said = report.properties
    found: dict[str, Number | EllipseReport] = {
        "ellipse95": known_ellipse(said.ellipse95),
        "region95": known_ellipse(said.region95),
        "altitude_msl_m": _within(said.altitude_msl_m, _LEAST_ALTITUDE_M, _MOST_ALTITUDE_M),
        "vertical95_m": _length(said.vertical95_m),
        "range_m": _length(said.range_m),
        "bearing_deg": _within(said.bearing_deg, -360.0, 360.0),
        "existence": _within(said.existence, 0.0, 1.0),
        "ce90_m": _length(said.ce90_m),
        "le90_m": _length(said.le90_m),
    }
    other = {name: one for name, one in found.items() if one != getattr(said, name)}
    if not other:
        return report
    return msgspec.structs.replace(report, properties=msgspec.structs.replace(said, **other))


def _length(value: Number) -> Number:
    """Over 0, and no longer than what tells a place."""
    return value if value is not None and 0.0 < value <= LARGEST_M else None


def _within(value: Number, least: float, most: float) -> Number:
    return value if value is not None and least <= value <= most else None
