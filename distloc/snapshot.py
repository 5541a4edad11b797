"""What a localizer needs to go on after a restart, as plain data; `Localizer.snapshot` makes it.

A cloud is kept as an equally weighted sample. What only makes a track better, and comes back by itself, is left out:
the frames that it would see anew, its innovations, and tracks that nobody was told of.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from distloc.types import BoolArray, Extent, FloatArray, TargetState

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Axes:
    """Other axes and another clock: a position becomes `R @ p + shift_m`, a time `t + later_s`."""

    R: FloatArray
    shift_m: FloatArray
    later_s: float

    def place(self, position_enu_m: FloatArray) -> FloatArray:
        """A position (3,) in the other axes."""
        return np.asarray(self.R @ position_enu_m + self.shift_m)


@dataclass(frozen=True, slots=True)
class FilterSnapshot:
    """Equally likely particles (3, n) about an origin (3,), their means (5, n) of bias and aim, and what all share.

    `nuisance_covariance` is (5, 5), the variances of the bias (3, 3), the aim's error right and up (2,).
    Raises ValueError where they are not finite,
    of other shapes, or no covariances.
    """

    stamp_s: float
    origin_enu_m: FloatArray
    positions_m: Float32Array
    nuisances: Float32Array
    nuisance_covariance: FloatArray
    bias_variance: FloatArray
    widest_variance: FloatArray
    aim_sigma_rad: FloatArray

    def __post_init__(self) -> None:
        n = self.positions_m.shape[-1] if self.positions_m.ndim else 0
        _check("stamp_s", np.array(self.stamp_s), ())
        _check("origin_enu_m", self.origin_enu_m, (3,))
        _check("positions_m", self.positions_m, (3, max(n, 1)))
        _check("nuisances", self.nuisances, (5, n))
        _check("aim_sigma_rad", self.aim_sigma_rad, (2,))
        if self.aim_sigma_rad.min() < 0.0:
            raise ValueError(f"aim_sigma_rad must be 0 or more, got {self.aim_sigma_rad.tolist()}")
        for name, matrix, size in (
            ("nuisance_covariance", self.nuisance_covariance, 5),
            ("bias_variance", self.bias_variance, 3),
            ("widest_variance", self.widest_variance, 3),
        ):
            _check(name, matrix, (size, size))
            if np.linalg.eigvalsh(matrix)[0] < -1e-9 or not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-12):
                raise ValueError(f"{name} must be a covariance, got {matrix.tolist()}")

    def moved(self, axes: Axes) -> "FilterSnapshot":
        """The same in other axes: the bias turns with them, the aim's error is right and up of the ray in any.

        The variances stay: they are of heading and tilt wherever one is, alike about all level axes.
        """
        R_all = np.eye(5)
        R_all[:3, :3] = axes.R
        return replace(
            self,
            stamp_s=self.stamp_s + axes.later_s,
            origin_enu_m=axes.place(self.origin_enu_m),
            positions_m=(axes.R @ self.positions_m).astype(np.float32),
            nuisances=(R_all @ self.nuisances).astype(np.float32),
            nuisance_covariance=R_all @ self.nuisance_covariance @ R_all.T,
        )


@dataclass(frozen=True, slots=True)
class AspectSnapshot:
    """The camera (3,) at the last sighting, the side that it saw, and visits and sightings (k,) of the k sides around.

    Side 0 begins in the north and the next is to the east. Raises ValueError where they do not fit together.
    """

    camera_enu_m: FloatArray
    side: int
    visits: IntArray
    sightings: IntArray

    def __post_init__(self) -> None:
        _check("camera_enu_m", self.camera_enu_m, (3,))
        for name, counts in (("visits", self.visits), ("sightings", self.sightings)):
            if counts.ndim != 1 or counts.dtype != np.int64 or counts.min(initial=0) < 0:
                raise ValueError(f"{name} must be whole numbers (k,), 0 or more, got {counts.tolist()}")
        if self.visits.shape != self.sightings.shape or (self.visits > self.sightings).any():
            raise ValueError("no side can have more visits than sightings")
        if not 0 <= self.side < self.visits.size or self.visits[self.side] < 1:
            raise ValueError(f"side must be one of those that were visited, got {self.side}")

    def moved(self, axes: Axes) -> "AspectSnapshot":
        """The same in other axes, to the nearest side."""
        east, north = axes.R[:2, 1]
        sides = self.visits.size
        turned = round(float(np.arctan2(east, north)) / (2.0 * np.pi) * sides)
        return AspectSnapshot(
            axes.place(self.camera_enu_m),
            (self.side + turned) % sides,
            np.roll(self.visits, turned),
            np.roll(self.sightings, turned),
        )


@dataclass(frozen=True, slots=True)
class LifeSnapshot:
    """A track's life; `recent` (m,) says which of the last frames showed it, the oldest first."""

    id: int
    state: TargetState
    observations: int
    misses: int
    first_seen_s: float
    last_seen_s: float
    baseline_m: float
    first_position_enu_m: FloatArray
    sure_after: int
    since_doubt: int
    recent: BoolArray

    def __post_init__(self) -> None:
        _check("first_position_enu_m", self.first_position_enu_m, (3,))
        _check("times and baseline", np.array([self.first_seen_s, self.last_seen_s, self.baseline_m]), (3,))
        counts = (self.id - 1, self.observations, self.misses, self.sure_after, self.since_doubt)
        if min(counts) < 0 or self.recent.ndim != 1:
            raise ValueError(f"counts must be 0 or more and ids above 0, got {counts}")

    def moved(self, axes: Axes) -> "LifeSnapshot":
        """The same in other axes."""
        return replace(
            self,
            first_seen_s=self.first_seen_s + axes.later_s,
            last_seen_s=self.last_seen_s + axes.later_s,
            first_position_enu_m=axes.place(self.first_position_enu_m),
        )


@dataclass(frozen=True, slots=True)
class TrackSnapshot:
    """One target: `sizes_px` (n, 2) of its latest segments, `highest_m` the camera's greatest height.

    `views` (k, 4) are where the craft was when it was seen, east and north, its headings, and what those err by.
    `bearings` (k, 8) are rows as `Bearings` holds them, the first was at `first_s`. Its root looked `root_rad` wide
    and jumped about by `jitter_rad2` (2,), the whole looked `looks_rad` (2,) wide and high; 0 where nobody knows.
    `lean` (2,) and `lean_information` (2, 2) are sums that `Lean` goes by. How it looks and `views` are by `platform`,
    which saw it last.
    """

    filter: FilterSnapshot
    life: LifeSnapshot
    sizes_px: FloatArray
    extent: Extent
    aspect: AspectSnapshot
    views: FloatArray
    highest_m: float
    is_plausible: bool
    misses: int
    unseen_steps: int
    bearings: FloatArray
    first_s: float
    root_rad: float
    looks_rad: FloatArray
    jitter_rad2: FloatArray
    lean: FloatArray
    lean_information: FloatArray
    platform: str = ""

    def __post_init__(self) -> None:
        _check("bearings", self.bearings, (self.bearings.shape[0] if self.bearings.ndim else 0, 8))
        # not in time: a clock goes back, and two platforms' need not agree
        ages = [self.bearings[self.bearings[:, 7] == source, 6] for source in set(self.bearings[:, 7].tolist())]
        if (self.bearings[:, 4:6] < 0.0).any() or any((np.diff(age) < 0.0).any() for age in ages):
            raise ValueError("bearings must err by 0 or more, and those of one source rise in age")
        _check("first_s and root_rad", np.array([self.first_s, self.root_rad]), (2,))
        _check("looks_rad", self.looks_rad, (2,))
        _check("jitter_rad2", self.jitter_rad2, (2,))
        if min(self.jitter_rad2.min(), self.looks_rad.min()) < 0.0:
            raise ValueError("jitter_rad2 and looks_rad must be 0 or more")
        _check("lean", self.lean, (2,))
        _check("lean_information", self.lean_information, (2, 2))
        if np.linalg.eigvalsh(self.lean_information)[0] <= 0.0 or self.root_rad < 0.0:
            raise ValueError(f"lean_information must be positive definite, got {self.lean_information.tolist()}")
        _check("sizes_px", self.sizes_px, (self.sizes_px.shape[0] if self.sizes_px.ndim else 0, 2))
        extent = self.extent
        sizes_m = (extent.width_m, extent.width_sigma_m, extent.height_m, extent.height_sigma_m)
        _check("extent and height", np.array([*sizes_m, self.highest_m]), (5,))
        _check("views", self.views, (self.views.shape[0] if self.views.ndim else 0, 4))
        if self.views[:, 3].min(initial=0.0) < 0.0:
            raise ValueError(f"a view's error must be 0 or more, got {self.views[:, 3].tolist()}")
        if min(self.misses, self.unseen_steps) < 0:
            raise ValueError(f"counts must be 0 or more, got {self.misses} and {self.unseen_steps}")

    def moved(self, axes: Axes) -> "TrackSnapshot":
        """The same in other axes; what the tilt does to a height as such is left out."""
        views = self.views.copy()
        views[:, :2] = views[:, :2] @ axes.R[:2, :2].T + axes.shift_m[:2]
        turned_rad, level = np.arctan2(axes.R[0, 1], axes.R[1, 1]), axes.R[:2, :2]
        views[:, 2] += turned_rad
        bearings = self.bearings.copy()
        bearings[:, 0] += axes.later_s
        bearings[:, 1:3] = bearings[:, 1:3] @ level.T + axes.shift_m[:2]
        bearings[:, 3] += turned_rad
        return replace(
            self,
            filter=self.filter.moved(axes),
            life=self.life.moved(axes),
            aspect=self.aspect.moved(axes),
            views=views,
            bearings=bearings,
            first_s=self.first_s + axes.later_s,
            lean=level @ self.lean,
            lean_information=level @ self.lean_information @ level.T,
            highest_m=self.highest_m + float(axes.shift_m[2]),
        )


@dataclass(frozen=True, slots=True)
class LocalizerSnapshot:
    """All targets that were told of, and the id that comes next. Raises ValueError for ids given twice.

    The attitude's error in them is that of `platform`.
    """

    next_id: int
    tracks: tuple[TrackSnapshot, ...]
    platform: str = ""

    def __post_init__(self) -> None:
        ids = [one.life.id for one in self.tracks]
        if len(set(ids)) != len(ids) or max(ids, default=0) >= self.next_id:
            raise ValueError(f"ids must differ and be under next_id, {self.next_id}, got {ids}")

    def moved(self, axes: Axes) -> "LocalizerSnapshot":
        """The same in other axes and on another clock."""
        return replace(self, tracks=tuple(one.moved(axes) for one in self.tracks))


def _check(name: str, values: FloatArray | Float32Array, shape: tuple[int, ...]) -> None:
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite and of shape {shape}, got shape {values.shape}")
