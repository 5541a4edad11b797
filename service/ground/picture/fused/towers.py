"""Towers and their alerts: a direction in which a camera at a known place sees smoke. Bounded, checked, free of I/O."""

import json
import math
import re
from collections import OrderedDict
from collections.abc import Mapping, Sequence, Set
from typing import Annotated, Literal

import msgspec
import numpy as np

from distloc.batch.fusion.claims import Bearing
from distloc.geometry.geodesy import LocalFrame
from service.ground.picture.clock import utc_s_from_text
from service.ground.picture.drone import on_earth
from service.ground.picture.views import SectorView, TowerView

MOST_TOWERS, MOST_SECTORS = 64, 8
MOST_ALERT_BYTES = 4_096
REACH_M = 40_000.0  # what is farther a tower does not see
HELD_S = 600.0  # an alert says so much longer that there is smoke
_MOST_AHEAD_S = 300.0
_LEAST_WEIGHT = 0.01  # of a bearing: as it gets old it counts for less, so that none ends at a stroke
_ONE_SITE_M = 50.0  # two towers nearer than that, in one direction, are one camera under two names, or as good as
_NEAR_M, _FAR_M = 1_000.0, 200_000.0  # a tower stands; all that one ground hears is within so much
_SAME_DEG = 3.0  # two alerts of a tower nearer than that are of one smoke, or as near as their openings
_BIAS_DEG = 3.0  # of a mount that nobody measured: real ones were 1.5, -1.4, 4.5 and 1.6 off
_LEAST_SIGMA_DEG = 0.3
_SEES_M = 60_000.0  # a tower that is farther from all others sees none of their fires
_SWAPPED = "latitude and longitude swapped"
_NO_OBJECT = "not readable: a JSON object is expected"
_LACKING, _WRONG = re.compile(r"missing required field `(\w+)`"), re.compile(r" - at `\$\.(\w+)`$")
_Name = Annotated[
    str,
    msgspec.Meta(
        pattern=r"^[A-Za-z0-9._-]+$", max_length=64, description="letters, digits, '.', '_' and '-', 64 at most"
    ),
]
_Sigma = Annotated[float, msgspec.Meta(gt=0.0, le=45.0, description="a number over 0, 45 at most")]


class Alert(msgspec.Struct, frozen=True, kw_only=True):
    """What a tower says, on `distloc/PLATFORM/alerts` or by POST to `alerts`.

    `azimuth_deg` is clockwise from true north to the middle of the smoke, `opening_deg` how wide it is seen,
    `sigma_deg` one standard deviation of the azimuth but for the mount's error, `mount_sigma_deg` that of the mount.
    The descriptions tell who sends one that can't be used what is right; a latitude of up to 180 may be swapped.
    """

    schema: Annotated[Literal["distloc/alert/1"], msgspec.Meta(description="distloc/alert/1, or left out")] = (
        "distloc/alert/1"
    )
    platform: _Name
    lat_deg: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0, description="a number from -90 to 90")]
    lon_deg: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0, description="a number from -180 to 180")]
    altitude_msl_m: (
        Annotated[float, msgspec.Meta(ge=-500.0, le=9_000.0, description="a number from -500 to 9000")] | None
    ) = None
    azimuth_deg: Annotated[float, msgspec.Meta(ge=-360.0, le=360.0, description="a number from -360 to 360")]
    opening_deg: Annotated[float, msgspec.Meta(gt=0.0, le=120.0, description="a number over 0, 120 at most")]
    time_utc: Annotated[str, msgspec.Meta(description="a time in UTC, as 2026-11-28T15:47:12Z")]
    sigma_deg: _Sigma | None = None
    mount_sigma_deg: _Sigma | None = None

    @property
    def key(self) -> str:
        """On zenoh: one for each direction, so that two at one moment are two."""
        return f"distloc/{self.platform}/alerts/{round(self.azimuth_deg) % 360}"

    @property
    def used_sigma_deg(self) -> float:
        """As told, else of a fire anywhere in the opening."""
        return max(self.sigma_deg or self.opening_deg / math.sqrt(12.0), _LEAST_SIGMA_DEG)


_MAY_BE = {
    name: next(part["description"] for part in (one, *one.get("anyOf", ())) if "description" in part)
    for name, one in msgspec.json.schema(Alert)["$defs"]["Alert"]["properties"].items()
}


class Towers:
    """The last alerts of each tower; `refused` counts by reason what could not be used."""

    def __init__(self) -> None:
        self.refused: dict[str, int] = {}
        self._alerts: OrderedDict[str, list[tuple[Alert, float]]] = OrderedDict()  # with when each was told, here
        self._bias: dict[str, tuple[float, float, int]] = {}
        self._fire_of: dict[str, str] = {}

    def hear(self, platform: str, payload: bytes, now_s: float, places: list[tuple[float, float]]) -> bool:
        """An alert as it came; whether it could be used. `places` are where drones are, in degrees."""
        alert = self.alert_or_fault(payload, now_s, places)
        if not isinstance(alert, str) and platform and alert.platform != platform:
            alert = "of another name than its key"
        if isinstance(alert, str):
            self.refuse(alert)
            return False
        told_s = min(utc_s_from_text(alert.time_utc) or now_s, now_s)
        known = self._alerts.get(alert.platform, [])
        if any(_is_of_same(one, alert) and at_s > told_s for one, at_s in known):
            return True  # a late copy
        others = [(one, at_s) for one, at_s in known if not _is_of_same(one, alert)]
        self._alerts[alert.platform] = [*others, (alert, told_s)][-MOST_SECTORS:]
        self._alerts.move_to_end(alert.platform)
        if len(self._alerts) > MOST_TOWERS:
            self._alerts.popitem(last=False)
        return True

    def refuse(self, reason: str) -> None:
        """Count it; the reasons are ours, so they are few."""
        self.refused[reason] = self.refused.get(reason, 0) + 1

    def alert_or_fault(self, payload: bytes, now_s: float, places: list[tuple[float, float]]) -> Alert | str:
        """The alert, or why it is none that can be used."""
        alert = _read(payload)
        if isinstance(alert, str):
            return alert
        return _fault_of_time(alert, now_s) or self._fault_of_place(alert, places) or alert

    def _fault_of_place(self, alert: Alert, places: list[tuple[float, float]]) -> str | None:
        here, swapped = (alert.lat_deg, alert.lon_deg), (alert.lon_deg, alert.lat_deg)
        if not on_earth(*here):
            return _SWAPPED if on_earth(*swapped) else _must_be("lat_deg")
        others = places or [_place(own[-1][0]) for name, own in self._alerts.items() if name != alert.platform]
        if fault := _fault_among(here, others):
            return fault
        known = self._alerts.get(alert.platform)
        if not known or _apart_m(where := _place(known[-1][0]), here) <= _NEAR_M:
            return None
        return _SWAPPED if on_earth(*swapped) and _apart_m(where, swapped) <= _FAR_M else "a tower in two places"

    def check(self, places: list[tuple[float, float]]) -> None:
        """Leave out what was taken when no drone was known yet, and is nowhere near those that are."""
        for platform, own in list(self._alerts.items()):
            if fault := _fault_among(_place(own[-1][0]), places):
                self.refuse(fault)
                del self._alerts[platform]

    def forget(self, now_s: float) -> None:
        """What was told too long ago."""
        for platform, own in list(self._alerts.items()):
            kept = [(one, at_s) for one, at_s in own if now_s - at_s <= HELD_S]
            if kept:
                self._alerts[platform] = kept
            else:
                del self._alerts[platform]

    def set_clock_on(self, step_s: float) -> None:
        """The ground's own clock was set by so much."""
        for platform, own in self._alerts.items():
            self._alerts[platform] = [(one, at_s + step_s) for one, at_s in own]

    def places(self) -> dict[str, tuple[float, float]]:
        """Where each stands, in degrees, by name."""
        return {platform: _place(own[-1][0]) for platform, own in sorted(self._alerts.items())}

    def bearings(self, frame: LocalFrame, names: Set[str], now_s: float) -> list[Bearing]:
        """Each of these towers' as the fusion takes it; north is the plane's, which at another meridian is not theirs.

        Of one camera under two names each direction counts once.
        """
        told = [(one, at_s) for name in sorted(names) for one, at_s in self._alerts.get(name, ())]
        kept = list[Alert]()
        found = []
        for one, at_s in sorted(told, key=lambda pair: (-pair[1], _name(pair[0]))):
            if not any(_is_copy(one, other) for other in kept):
                kept.append(one)
                found.append(_bearing(one, frame, 1.0 - (now_s - at_s) / HELD_S))
        return found

    def learn(self, bias: dict[str, tuple[float, float, int]], fire_of: dict[str, str]) -> None:
        """What the fusion found of the mounts, in radians with one standard deviation, from how many fires; and which
        fire each bearing is of."""
        self._bias, self._fire_of = bias, fire_of

    def views(self) -> list[TowerView]:
        """As the page is told."""
        found = []
        for platform, own in sorted(self._alerts.items()):
            last, bias = own[-1][0], self._bias.get(platform)
            found.append(
                TowerView(
                    name=platform,
                    lat_deg=last.lat_deg,
                    lon_deg=last.lon_deg,
                    altitude_msl_m=last.altitude_msl_m,
                    error_deg=None if bias is None else round(math.degrees(bias[0]), 2),
                    error_sigma_deg=None if bias is None else round(math.degrees(bias[1]), 2),
                    fires=0 if bias is None else bias[2],
                    sectors=[
                        SectorView(
                            azimuth_deg=one.azimuth_deg % 360.0,
                            opening_deg=one.opening_deg,
                            told_s=told_s,
                            fire=self._fire_of.get(_name(one), ""),
                        )
                        for one, told_s in own
                    ],
                )
            )
        return found


def seen_together(
    towers: Mapping[str, tuple[float, float]], fires: Sequence[tuple[float, float]]
) -> list[tuple[frozenset[str], list[int]]]:
    """Towers and fires, by places in degrees, that hang together: each tower with all that is in its reach."""
    names, found = sorted(towers), []
    away_deg = np.array(fires).reshape(-1, 2) - np.array([towers[one] for one in names]).reshape(-1, 1, 2)
    middle = np.radians(np.array([towers[one][0] for one in names])[:, None] + 0.5 * away_deg[:, :, 0])
    east_deg = ((away_deg[:, :, 1] + 180.0) % 360.0 - 180.0) * np.cos(middle)
    in_reach = 111_320.0 * np.hypot(east_deg, away_deg[:, :, 0]) <= REACH_M
    left = in_reach.any(axis=1)
    while left.any():
        rows = np.arange(len(names)) == int(left.argmax())
        while (more := in_reach[:, in_reach[rows].any(axis=0)].any(axis=1)).sum() > rows.sum():
            rows = more
        left &= ~rows
        seen = np.flatnonzero(in_reach[rows].any(axis=0))
        found.append((frozenset(names[row] for row in np.flatnonzero(rows)), [int(one) for one in seen]))
    return found


def _bearing(one: Alert, frame: LocalFrame, weight: float) -> Bearing:
    lat0_deg, lon0_deg, _ = frame.origin
    turn_deg = _wrapped_deg(one.lon_deg - lon0_deg) * math.sin(math.radians(0.5 * (lat0_deg + one.lat_deg)))
    return Bearing(
        name=_name(one),
        tower=one.platform,
        position_en_m=frame.enu_from_geodetic(one.lat_deg, one.lon_deg, 0.0)[:2],
        azimuth_rad=math.radians(one.azimuth_deg - turn_deg),
        sigma_rad=math.radians(one.used_sigma_deg) / math.sqrt(min(max(weight, _LEAST_WEIGHT), 1.0)),
        bias_rad=math.radians(one.mount_sigma_deg or _BIAS_DEG),
        reach_m=REACH_M,
    )


def _is_copy(one: Alert, other: Alert) -> bool:
    is_near = one.platform != other.platform and _apart_m(_place(one), _place(other)) <= _ONE_SITE_M
    return is_near and _is_of_same(one, other)


def _name(alert: Alert) -> str:
    return f"{alert.platform}@{alert.azimuth_deg:g}"


def _is_of_same(one: Alert, other: Alert) -> bool:
    apart = abs(_wrapped_deg(one.azimuth_deg - other.azimuth_deg))
    return apart <= max(_SAME_DEG, 0.5 * min(one.opening_deg, other.opening_deg))


def _read(payload: bytes) -> Alert | str:
    """The alert, or which field is wrong and what it may be: few lines, whatever comes."""
    if len(payload) > MOST_ALERT_BYTES:
        return "too large"
    try:
        return msgspec.json.decode(payload, type=Alert)
    except msgspec.ValidationError as error:
        lacking, wrong = _LACKING.search(str(error)), _WRONG.search(str(error))
        if lacking:
            return f"lacks {lacking[1]}: {_MAY_BE[lacking[1]]}"
        return _must_be(wrong[1]) if wrong else _NO_OBJECT
    except (msgspec.DecodeError, RecursionError):
        return _not_finite(payload) or _NO_OBJECT


def _not_finite(payload: bytes) -> str | None:
    """Which number is NaN or infinite, as some programs write what JSON has no word for."""
    try:
        said = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    for name in _MAY_BE if isinstance(said, dict) else ():
        if isinstance(said.get(name), float) and not math.isfinite(said[name]):
            return _must_be(name)
    return None


def _must_be(name: str) -> str:
    return f"{name} must be {_MAY_BE[name]}"


def _fault_among(here: tuple[float, float], others: list[tuple[float, float]]) -> str | None:
    """Whether a tower stands near the others; where its swapped coordinates do, those are meant."""
    away_m = min((_apart_m(one, here) for one in others), default=0.0)
    swapped = (here[1], here[0])
    swapped_m = min((_apart_m(one, swapped) for one in others), default=math.inf) if on_earth(*swapped) else math.inf
    if away_m > _SEES_M and swapped_m <= _SEES_M:
        return _SWAPPED
    if away_m <= _FAR_M:
        return None
    return _SWAPPED if swapped_m <= _FAR_M else "over 200 km from all others"


def _fault_of_time(alert: Alert, now_s: float) -> str | None:
    time_s = utc_s_from_text(alert.time_utc)
    if time_s is None or not alert.time_utc.endswith(("Z", "+00:00")):
        return _must_be("time_utc")
    if time_s < now_s - HELD_S:
        return "over ten minutes old"
    return "of the future" if time_s > now_s + _MOST_AHEAD_S else None


def _place(alert: Alert) -> tuple[float, float]:
    return alert.lat_deg, alert.lon_deg


def _wrapped_deg(angle: float) -> float:
    return (angle + 180.0) % 360.0 - 180.0


def _apart_m(one: tuple[float, float], other: tuple[float, float]) -> float:
    middle = math.radians(0.5 * (one[0] + other[0]))
    east_deg = _wrapped_deg(one[1] - other[1]) * math.cos(middle)
    return 111_320.0 * float(np.hypot(east_deg, one[0] - other[0]))
