"""Sightings as arrays in one local frame, in an order that is their own and not that of the rows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from distloc.batch.sighting import Sighting
from distloc.geometry.earth import LIFT_RAD_PER_M
from distloc.geometry.geodesy import LocalFrame, ecef_from_geodetic, geodetic_from_ecef
from distloc.types import BoolArray, FloatArray, PoseErrors

IntArray = np.ndarray[tuple[int], np.dtype[np.intp]]

_STRAIGHT = 1e-3  # level part of a direction under which it has no azimuth


@dataclass(frozen=True, slots=True)
class Lines:
    """N lines of sight, those of a platform one after the other in the order of their time.

    `index` (N,) is where each was in what `locate` was given. `position_enu_m` and `direction_enu` are (N, 3), `basis`
    (N, 2, 3) has across (to the right) and upright of each, `to_bias` (N, 2, 3) what a small turn of the attitude about
    east, north and up moves it by in these. `mark` (N, 2) is one standard deviation of how the target was marked,
    `attitude_white` (N,) and `position_m` (N,) those of the picture's attitude and position; of its heading too, where
    `is_heading_told`, `heading_white` (N,). Lines of one `picture` (N,) share these. `kept` (N,) is the
    share of the slow error that is left since the platform's sighting before, 0 at its first, with `bias_variance`
    (N, 3).
    """

    index: IntArray
    position_enu_m: FloatArray
    direction_enu: FloatArray
    up: FloatArray
    basis: FloatArray
    to_bias: FloatArray
    mark: FloatArray
    attitude_white: FloatArray
    heading_white: FloatArray
    position_m: FloatArray
    position_bias_m: FloatArray
    kept: FloatArray
    bias_variance: FloatArray
    platform: IntArray
    picture: IntArray
    stamp_s: FloatArray  # NaN where not known
    is_heading_told: BoolArray

    def __len__(self) -> int:
        return len(self.index)

    def of(self, chosen: BoolArray) -> "Lines":
        """Those where `chosen` (N,) is True; what lies between two of a platform's still parts their errors."""
        kept = np.empty(len(self))
        passed = 1.0
        for i, (share, is_chosen) in enumerate(zip(self.kept.tolist(), chosen.tolist(), strict=True)):
            passed *= share
            kept[i] = passed
            if is_chosen:
                passed = 1.0
        values = {name: getattr(self, name)[chosen] for name in self.__dataclass_fields__}
        values["kept"] = kept[chosen]
        return replace(self, **values)

    def residuals(self, points_enu_m: FloatArray) -> FloatArray:
        """What each sighting shows beside each point (K, 3), in radians across and upright: (N, 2, K)."""
        return self._shown(points_enu_m.T[None] - self.position_enu_m[:, :, None])

    def residuals_each(self, points_enu_m: FloatArray) -> FloatArray:
        """The same of each sighting beside a point of its own (N, 3): (N, 2, 1)."""
        return self._shown((points_enu_m - self.position_enu_m)[:, :, None])

    def _shown(self, offset_m: FloatArray) -> FloatArray:
        """Of points at offsets (N, 3, K) from the cameras."""
        range_m = np.sqrt(np.einsum("nik,nik->nk", offset_m, offset_m))
        towards = offset_m / np.maximum(range_m, 1e-6)[:, None]
        beside = self.basis @ towards  # (N, 2, K)
        along = np.einsum("ni,nik->nk", self.direction_enu, towards)
        shown = -beside * _angle_by_sine(np.square(beside).sum(axis=1), along)[:, None]
        level = np.einsum("ni,ni->n", self.basis[:, 1], self.up)
        shown[:, 1] -= LIFT_RAD_PER_M * level[:, None] * range_m
        return np.asarray(shown)

    def ranges_m(self, points_enu_m: FloatArray) -> FloatArray:
        """(N, K)."""
        return np.asarray(np.linalg.norm(points_enu_m[None] - self.position_enu_m[:, None], axis=2))


def _angle_by_sine(squared: FloatArray, along: FloatArray) -> FloatArray:
    """Angles by their sines, of these squared and the cosines; a series to 1e-7 where all are under 0.2."""
    if squared.max(initial=0.0) < 0.04 and along.min(initial=1.0) > 0.0:
        return np.asarray(1.0 + squared * (1 / 6 + squared * (3 / 40 + squared * (5 / 112))))
    sine = np.sqrt(squared)
    return np.where(sine > 1e-9, np.arctan2(sine, along) / np.maximum(sine, 1e-12), 1.0)


def frame_of(sightings: Sequence[Sighting]) -> LocalFrame:
    """A local frame in the middle of the cameras."""
    places = sorted({(one.lat_deg, one.lon_deg, one.height_m) for one in sightings})
    middle = np.mean([ecef_from_geodetic(*place) for place in places], axis=0)
    lat_deg, lon_deg, _ = geodetic_from_ecef(middle)
    return LocalFrame(lat_deg, lon_deg, float(np.mean([height for _, _, height in places])))


def order_of(one: Sighting) -> tuple[object, ...]:
    """What sightings are sorted by: all that they are, so that the same table gives the same whatever its order."""
    stamp = float("inf") if one.stamp_s is None else one.stamp_s
    place = (one.lat_deg, one.lon_deg, one.height_m)
    heading = one.azimuth_rad if one.heading_rad is None else one.heading_rad
    return (one.platform, stamp, heading, *place, *one.direction_enu.tolist(), one.target or "", one.sigma_rad)


def lines_of(sightings: Sequence[Sighting], platforms: Sequence[str], frame: LocalFrame, errors: PoseErrors) -> Lines:
    """Sightings in the frame; `platforms` names who carries each."""
    order = sorted(range(len(sightings)), key=lambda i: (platforms[i], order_of(sightings[i])))
    ordered = [sightings[i] for i in order]
    told = [one.errors or errors for one in ordered]
    position, direction, up = _in_frame(ordered, frame)
    across = np.cross(direction, up)
    level = np.linalg.norm(across, axis=1, keepdims=True)
    north = np.cross(direction, np.array([0.0, 1.0, 0.0]))
    across = np.where(level > _STRAIGHT, across, north)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    basis = np.stack([across, np.cross(across, direction)], axis=1)
    # a turn b moves the direction d by b x d, which in a basis e is (d x e) . b
    to_bias = np.cross(direction[:, None], basis)
    names = [platforms[i] for i in order]
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    platform = np.array([numbers[name] for name in names], dtype=np.intp)
    picture = _pictures(ordered, names)
    return Lines(
        index=np.array(order, dtype=np.intp),
        position_enu_m=position,
        direction_enu=direction,
        up=up,
        basis=basis,
        to_bias=to_bias,
        mark=np.array([one.sigma_rad for one in ordered]),
        attitude_white=np.array([one.attitude_white_rad for one in told]),
        heading_white=np.array([one.heading_white_rad or 0.0 for one in ordered]),
        position_m=np.array([one.position_m for one in told]),
        position_bias_m=np.array([one.position_bias_m for one in told]),
        kept=_kept(ordered, told, platform, position, picture),
        bias_variance=np.array([np.diag(one.bias_variance) for one in told]),
        platform=platform,
        picture=picture,
        stamp_s=np.array([np.nan if one.stamp_s is None else one.stamp_s for one in ordered]),
        is_heading_told=np.array([one.heading_white_rad is not None for one in ordered]),
    )


def _in_frame(ordered: list[Sighting], frame: LocalFrame) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions, directions and the local verticals (N, 3)."""
    at: dict[tuple[float, float, float], tuple[FloatArray, FloatArray]] = {}
    position, direction, up = (np.empty((len(ordered), 3)) for _ in range(3))
    for i, one in enumerate(ordered):
        place = (one.lat_deg, one.lon_deg, one.height_m)
        if place not in at:
            at[place] = frame.from_other(LocalFrame(*place))
        R_frame_from_own, position[i] = at[place]
        direction[i], up[i] = R_frame_from_own @ one.direction_enu, R_frame_from_own[:, 2]
    return position, direction, up


def _pictures(ordered: list[Sighting], names: list[str]) -> IntArray:
    """Numbers (N,) of the pictures: sightings of one platform at one time and place are of one."""
    numbers = np.zeros(len(ordered), dtype=np.intp)
    for i in range(1, len(ordered)):
        before, now = ordered[i - 1], ordered[i]
        is_same = names[i] == names[i - 1] and now.stamp_s is not None and now.stamp_s == before.stamp_s
        is_there = (now.lat_deg, now.lon_deg, now.height_m) == (before.lat_deg, before.lon_deg, before.height_m)
        numbers[i] = numbers[i - 1] + (not (is_same and is_there))
    return numbers


def _kept(
    ordered: list[Sighting], told: list[PoseErrors], platform: IntArray, position: FloatArray, picture: IntArray
) -> FloatArray:
    """The share (N,) of the slow error that is left since the sighting before: by time and by the craft's turn."""
    kept = np.zeros(len(ordered))
    headings = _headings(ordered, picture)
    for number in np.unique(platform):
        own = np.flatnonzero(platform == number)
        is_fixed = float(np.ptp(position[own], axis=0).max()) < 1e-2
        for before, now in pairwise(own.tolist()):
            if is_fixed or picture[before] == picture[now]:
                kept[now] = 1.0
                continue
            stamps = ordered[before].stamp_s, ordered[now].stamp_s
            elapsed_s = 0.0 if stamps[0] is None or stamps[1] is None else abs(stamps[1] - stamps[0])
            turned_rad = abs((headings[now] - headings[before] + np.pi) % (2.0 * np.pi) - np.pi)
            spent = elapsed_s / told[now].bias_time_constant_s + turned_rad / told[now].bias_turn_rad
            kept[now] = np.exp(-spent)
    return kept


def _headings(ordered: list[Sighting], picture: IntArray) -> FloatArray:
    """Of the craft at each sighting (N,): as told, else the mean azimuth of what the picture shows."""
    azimuths = np.array([one.azimuth_rad if one.heading_rad is None else one.heading_rad for one in ordered])
    sine = np.bincount(picture, np.sin(azimuths))
    cosine = np.bincount(picture, np.cos(azimuths))
    return np.asarray(np.arctan2(sine, cosine)[picture])
