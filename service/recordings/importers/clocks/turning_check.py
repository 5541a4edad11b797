"""Whether the angles of a source that claims to be on its film's clock turn as the film does; `distloc import` asks it.

Angles that stand still, are another flight's or come late look as good as true ones in every other way.
"""

from dataclasses import dataclass

import numpy as np

from distloc.calibration.time_offset import LEAST_USED, turn_residuals, without_slow
from distloc.types import FloatArray
from service.config.sections import CameraConfig
from service.recordings.importers.clocks.clock_tie import camera_trail, film_turns
from service.recordings.importers.flight import Film, ImportedFlight, ImportRefusedError

_MOST_PAIRS = 1_200  # two minutes of film
MOST_LATE_S = 3.0  # cues and packets come late by seconds at most
_STEP_S = 0.05
_LEAST_TURN_RAD = np.radians(0.4)  # over half a second: steady gimbals and what is near turn the picture by less
_LEAST_EXPLAINED = 0.5  # of the film's turning about an axis by the angles'
_LIKE, _AHEAD = 0.3, 2.0  # of the turning that may be left where it fits, and by how much more must be left elsewhere
_NEAR_S = 0.5  # half the width of one least
LATE_SIGMA_S = 0.1  # of a lateness that is found so: what is near, and the angles' last digit, move it
_LEAST_LATE_S = 0.25
_AXES = {"pitch": 0, "yaw": 1, "roll": 2}  # of the camera's x right, y down, z forward
_HEADING, _TILT = ("yaw", "roll"), ("pitch", "roll")


@dataclass(frozen=True, slots=True)
class Turning:
    """`late_s` (0 where they are on time): so much later than their frames the angles come.

    `unlike` are the axes about which the film turns and the angles do not; `astray_deg` by how much they then err.
    """

    late_s: float
    unlike: tuple[str, ...]
    astray_deg: float

    @property
    def yaw_deg(self) -> float:
        """What to add to the heading's sigma."""
        return self.astray_deg if set(self.unlike) & set(_HEADING) else 0.0

    @property
    def tilt_deg(self) -> float:
        """The same of roll and pitch."""
        return self.astray_deg if set(self.unlike) & set(_TILT) else 0.0


def turning_of(flight: ImportedFlight, camera: CameraConfig) -> Turning | None:
    """What the film's turning says of the angles; None where it does not tell: no film, no corners, too few angles."""
    if not isinstance(flight.frames, Film):
        return None
    try:
        starts_s, ends_s, turns_rad = film_turns(flight.frames, camera.camera(), flight.source, _MOST_PAIRS)
        trail, _ = camera_trail(flight, camera)
    except ImportRefusedError:
        return None
    if len(ends_s) < LEAST_USED:
        return None
    left_at = turn_residuals(trail, starts_s, ends_s, turns_rad)
    lates_s = np.arange(-MOST_LATE_S, MOST_LATE_S + _STEP_S / 2.0, _STEP_S)
    shares = np.array([_left_share(ends_s, turns_rad, left_at(-float(late_s))) for late_s in lates_s])
    on_time = int(np.argmin(np.abs(lates_s)))
    if not np.isfinite(shares[on_time]):
        return None
    late_s = _late_s(lates_s, shares, on_time)
    return Turning(late_s, *_unlike(starts_s, ends_s, turns_rad, left_at(-late_s)))


def _left_share(ends_s: FloatArray, turns_rad: FloatArray, left_rad: FloatArray) -> float:
    """Of the film's turning that is not slow, what the angles leave unexplained; NaN where too little is known."""
    is_known = np.isfinite(left_rad).all(axis=1)
    if is_known.sum() < max(LEAST_USED, 0.5 * len(ends_s)):
        return float("nan")
    left, film = (without_slow(ends_s[is_known], one[is_known]) for one in (left_rad, turns_rad))
    total = float(np.sum(film**2))
    return float(np.sum(left**2)) / total if total > 0.0 else float("nan")


def _late_s(lates_s: FloatArray, shares: FloatArray, on_time: int) -> float:
    """0 unless another time fits well, and far better than this and than all others."""
    best = int(np.nanargmin(shares))
    others = shares[np.isfinite(shares) & (np.abs(lates_s - lates_s[best]) > _NEAR_S)]
    is_sure = (
        abs(lates_s[best]) >= _LEAST_LATE_S
        and 0 < best < len(shares) - 1
        and shares[best] < _LIKE
        and shares[on_time] > _AHEAD * shares[best]
        and len(others) > 0
        and float(others.min()) > _AHEAD * shares[best]
    )
    if not is_sure:
        return 0.0
    before, at, after = shares[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    share = 0.5 * (before - after) / bend if np.isfinite(bend) and bend > 0.0 else 0.0
    return float(lates_s[best] + share * _STEP_S)


def _unlike(
    starts_s: FloatArray, ends_s: FloatArray, turns_rad: FloatArray, left_rad: FloatArray
) -> tuple[tuple[str, ...], float]:
    """The axes, and by how much what is left adds up to over the film, rms: 0 where there are none."""
    is_known = np.isfinite(left_rad).all(axis=1)
    if is_known.sum() < LEAST_USED:
        return (), 0.0
    film, left = (without_slow(ends_s[is_known], one[is_known]) for one in (turns_rad, left_rad))
    film_rad, left_part_rad = (np.sqrt(np.mean(one**2, axis=0)) for one in (film, left))
    unlike = tuple(
        name
        for name, axis in _AXES.items()
        if left_part_rad[axis] > _LEAST_TURN_RAD
        and left_part_rad[axis] ** 2 > (1.0 - _LEAST_EXPLAINED) * film_rad[axis] ** 2
    )
    if not unlike:
        return (), 0.0
    spans_s = np.diff(starts_s[is_known], append=ends_s[is_known][-1])
    rates = left_rad[is_known] / (ends_s - starts_s)[is_known, None]
    angles_deg = np.degrees(np.cumsum(rates * np.clip(spans_s, 0.0, 1.0)[:, None], axis=0))
    return unlike, float(max(np.ptp(angles_deg[:, _AXES[name]]) / 2.0 for name in unlike))
