"""A mission in one HTML file, for the after-action review: map, table, what became of each fire. It runs no script."""

import math
from base64 import b64encode
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime, timezone
from html import escape
from pathlib import Path

from service.ground.inbox import Heard
from service.ground.picture.fires import MOST_FIRES
from service.ground.picture.picture import COMPARE_S, Picture
from service.ground.picture.views import FireView, News
from service.ground.record.review_map import mission_map, size_plot

_MOST_POINTS = 300  # of a fire's way to its last word
_MOST_PLOTS = 100
_MOST_IMAGE_BYTES = 20_000_000
_STYLE = Path(__file__).resolve().parents[1] / "page" / "review.css"
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_HEADS = ("Fire", "State", "Place (WGS 84)", "MGRS", "95 % within", "Course")
_ORDER = ("confirmed", "coasting", "tentative", "dismissed")


@dataclass(slots=True)
class _Story:
    """What became of one fire: its size over time, thinned, and when its state changed."""

    sizes: list[tuple[float, float]] = field(default_factory=list)
    states: list[tuple[float, str]] = field(default_factory=list)

    def add(self, at_s: float, fire: FireView) -> None:
        if not self.states or self.states[-1][1] != fire.state:
            self.states = [*self.states[-49:], (at_s, fire.state)]
        is_new = not self.sizes or self.sizes[-1][0] < at_s
        if is_new and fire.ellipse95.semi_major_m is not None:
            self.sizes.append((at_s, fire.ellipse95.semi_major_m))
            if len(self.sizes) > _MOST_POINTS:
                self.sizes = self.sizes[::2]


def review(messages: Iterable[Heard], title: str) -> bytes:
    """The file's bytes, whatever the messages hold: bounded as the picture is, every string escaped."""
    picture, stories = Picture(), OrderedDict[str, _Story]()
    begin_s = end_s = None
    compared_s = -math.inf
    for one in messages:
        begin_s = one.arrived_s if begin_s is None else begin_s
        end_s = one.arrived_s
        if one.payload is None or one.payload == b"":
            picture.alive(one.key, one.payload is not None, one.arrived_s)
            continue
        picture.hear(one.key, one.payload, one.arrived_s, one.sender)
        if not 0.0 <= one.arrived_s - compared_s < COMPARE_S:
            compared_s = one.arrived_s
            picture.compare(compared_s)
        for fire in picture.changes(one.arrived_s).fires:
            stories.setdefault(fire.id, _Story()).add(one.arrived_s, fire)
            if len(stories) > MOST_FIRES:
                stories.popitem(last=False)
    picture.compare(end_s or 0.0)
    last = picture.whole(end_s or 0.0)
    return _page(title, last, stories, _images(last, picture), begin_s or 0.0, end_s or 0.0).encode()


def _images(last: News, picture: Picture) -> dict[str, str]:
    """The last picture of each fire while it was seen, as HTML; of so many as have room."""
    found, size = dict[str, str](), 0
    for fire in _sorted(last.fires):
        jpeg = picture.preview(fire.id)
        if jpeg is None or fire.made_of is not None or fire.preview_s is None or size + len(jpeg) > _MOST_IMAGE_BYTES:
            continue
        size += len(jpeg)
        seen = f"{fire.vehicle}'s camera at {_utc(fire.preview_s)}"
        data = b64encode(jpeg).decode()
        found[fire.id] = (
            f"<figure><img alt='{escape(seen)}' src='data:image/jpeg;base64,{data}'>"
            f"<figcaption>{escape(seen)}</figcaption></figure>"
        )
    return found


def _sorted(fires: Iterable[FireView]) -> list[FireView]:
    return sorted(fires, key=lambda one: (_ORDER.index(one.state), one.id))


def _page(
    title: str,
    last: News,
    stories: OrderedDict[str, _Story],
    images: dict[str, str],
    begin_s: float,
    end_s: float,
) -> str:
    fires = _sorted(last.fires)
    rows = "".join(_row(one, stories.get(one.id, _Story())) for one in fires)
    plots = "".join(
        _plot(one, stories[one.id], begin_s, end_s) + images.get(one.id, "")
        for one in fires[:_MOST_PLOTS]
        if one.id in stories
    )
    drones = "".join(
        f"<li>{escape(one.name)}: {escape(one.state or 'no state heard')}{_refused(one.refused)}</li>"
        for one in last.drones
    )
    count = sum(not one.fused for one in fires)
    span = f"{_utc(begin_s)} to {_utc(end_s)}, {count} fires reported by {len(last.drones)} drones"
    parts = (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">',
        '<meta name="viewport" content="width=device-width,initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE.read_text(encoding='utf-8')}</style></head><body>",
        f"<h1>{escape(title)}</h1><p class='quiet'>{span}</p>{mission_map(last)}<h2>Fires, as last reported</h2>",
        f"<table><thead><tr>{''.join(f'<th>{one}</th>' for one in _HEADS)}</tr></thead><tbody>{rows}</tbody></table>",
        f"<h2>How sure, over time</h2>{plots or '<p>No fire was reported.</p>'}",
        f"<h2>Drones</h2><ul>{drones}</ul></body></html>",
    )
    return "\n".join(parts)


def _row(fire: FireView, story: _Story) -> str:
    name = f"{fire.mark.name} ({fire.id})" if fire.mark is not None and fire.mark.name else fire.id
    state = fire.state
    if fire.mark is not None and fire.mark.verdict:
        where = f" on {fire.mark.ground}" if fire.mark.ground else ""
        state = f"not a fire, says the crew{where}, {_utc(fire.mark.time_s)}"
    minutes, mgrs = (fire.place.minutes, fire.place.mgrs) if fire.place else ("not known", "")
    name += f" (may be one with {', '.join(fire.may_be)})" if fire.may_be else ""
    name += _fused(fire)
    size = f"{_metres(fire.ellipse95.semi_major_m)} x {_metres(fire.ellipse95.semi_minor_m)} m"
    course = "<br>".join(f"{_utc(at_s)[11:19]} {escape(one)}" for at_s, one in story.states)
    cells = (escape(name), escape(state), escape(minutes).replace("  ", "<br>"), escape(mgrs), size, course)
    return f"<tr>{''.join(f'<td>{one}</td>' for one in cells)}</tr>"


def _fused(fire: FireView) -> str:
    """What it is made of, or part of, or who contradicts it."""
    if fire.made_of is None:
        part = f" (part of {fire.fused})" if fire.fused else ""
        return part + (f" (outvoted by {fire.outvoted_by})" if fire.outvoted_by else "")
    told = f" (fused of {', '.join((*fire.made_of.contributors, *fire.made_of.towers))}"
    words = ", ".join(f"{one.id}, {_metres(one.away_m)} m off" for one in fire.made_of.outvoted)
    return told + (f"; outvoted: {words})" if words else ")")


def _plot(fire: FireView, story: _Story, begin_s: float, end_s: float) -> str:
    return f"<h3>{escape(fire.id)}</h3>{size_plot(story.sizes, begin_s, end_s)}"


def _refused(refused: dict[str, int]) -> str:
    return "".join(f"; {count} messages refused: {escape(reason)}" for reason, count in refused.items())


def _metres(value: float | None) -> str:
    return "?" if value is None else f"{value:.0f}"


def _utc(time_s: float) -> str:
    return f"{datetime.fromtimestamp(time_s, timezone.utc):%Y-%m-%d %H:%M:%S} UTC"
