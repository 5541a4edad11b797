"""What a ground says of fused fires over zenoh: `distloc/GROUND/fused/ID`, a GeoJSON feature each. Free of I/O."""

import re
from typing import Literal

import msgspec

from service.ground.picture.fused.fusion import PREFIX
from service.ground.picture.views import FireView, OutvotedView
from service.publish.parts import EllipseReport, Number
from service.publish.wire import Point, Wire, utc_text

_KEY = re.compile(r"[^A-Za-z0-9._+-]")  # what a key may not have, or no name needs


class FusedProperties(Wire, frozen=True, kw_only=True):
    """`ended` is said once, when there is no such fire any more: it is part of another, or all gave it up."""

    schema: Literal["distloc/fused/1"] = "distloc/fused/1"
    ground: str
    fire: str
    state: Literal["tentative", "confirmed", "coasting", "dismissed", "ended"]
    time_utc: str | None
    last_seen_utc: str | None = None
    altitude_msl_m: Number = None
    ellipse95: EllipseReport | None = None
    contributors: tuple[str, ...] = ()
    undecided: tuple[str, ...] = ()
    outvoted: tuple[OutvotedView, ...] = ()
    towers: tuple[str, ...] = ()
    name: str = ""
    is_acknowledged: bool = False


class FusedReport(Wire, frozen=True, kw_only=True):
    """One fire that several tell of."""

    type: Literal["Feature"] = "Feature"
    geometry: Point | None
    properties: FusedProperties


class FusedTopic:
    """`messages` gives what is to be put, keys and payloads: all that changed, and what ended."""

    def __init__(self, ground: str) -> None:
        self._ground = ground
        self._told: dict[str, FusedReport] = {}

    def messages(self, fires: list[FireView], now_s: float) -> list[tuple[str, bytes]]:
        """Of the fused fires that there are now."""
        told = {one.id.removeprefix(PREFIX): self._report(one) for one in fires}
        changed = {one: report for one, report in told.items() if self._told.get(one) != report}
        ended = {one: self._ended(one, now_s) for one in self._told.keys() - told.keys()}
        self._told = told
        return [(self._key(one), msgspec.json.encode(report)) for one, report in sorted((changed | ended).items())]

    def _key(self, fire: str) -> str:
        parts = [_KEY.sub("_", part) for part in fire.split("/") if part]
        return "/".join(("distloc", self._ground or "ground", "fused", *parts))

    def _report(self, one: FireView) -> FusedReport:
        assert one.made_of is not None and one.lat_deg is not None and one.lon_deg is not None
        return FusedReport(
            geometry=Point(coordinates=[one.lon_deg, one.lat_deg]),
            properties=FusedProperties(
                ground=self._ground,
                fire=one.id.removeprefix(PREFIX),
                state=one.state,  # type: ignore[arg-type]  # a report's own
                time_utc=None if one.told_s is None else utc_text(one.told_s),
                last_seen_utc=None if one.seen_s is None else utc_text(one.seen_s),
                altitude_msl_m=one.altitude_msl_m,
                ellipse95=one.ellipse95,
                contributors=tuple(one.made_of.contributors),
                undecided=tuple(one.made_of.undecided),
                outvoted=tuple(one.made_of.outvoted),
                towers=tuple(one.made_of.towers),
                name="" if one.mark is None else one.mark.name,
                is_acknowledged=one.mark is not None and one.mark.is_acknowledged,
            ),
        )

    def _ended(self, fire: str, now_s: float) -> FusedReport:
        said = FusedProperties(ground=self._ground, fire=fire, state="ended", time_utc=utc_text(now_s))
        return FusedReport(geometry=None, properties=said)
