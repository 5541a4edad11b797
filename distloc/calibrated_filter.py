"""A particle filter over a static point, with the attitude's slow error as a conditionally linear nuisance.

Rao-Blackwellised (Doucet et al. 2000): each particle carries a position and the mean of the attitude error given it,
and all share one covariance of that error, for a small rotation moves what the camera sees by the same angle at any
range. A compass that is wrong for minutes then widens the cloud instead of moving it. The tracks call it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.resample import systematic_indices
from distloc.snapshot import FilterSnapshot, Float32Array
from distloc.types import FloatArray, PoseErrors

Prior = Callable[[FloatArray], FloatArray]  # logarithms of weights (B,) for positions (3, B) in ENU

_BLOCK = 8192  # particles at a time: what a step allocates does not grow with N, and a block stays in the cache
_SAMPLE = 2048  # particles that stand for the cloud where their order matters: gates, quantiles, snapshots
_SPREAD = 256  # that stand for how far it reaches
_NUISANCES = 5  # the bias about east, north and up, and the aim's error right and up
_KERNEL = 0.1  # bandwidth of the regularisation as a share of the cloud's standard deviation


@dataclass(frozen=True, slots=True)
class Sight:
    """A measured direction from a camera at `position_enu_m` (3,).

    `axes` (3, 3) has rows right, up and along the ray in ENU. `covariance` (2, 2) is that of the measurement's white
    errors, in tangents of the angles right and up.
    """

    stamp_s: float
    position_enu_m: FloatArray
    axes: FloatArray
    covariance: FloatArray

    @property
    def by_nuisance(self) -> FloatArray:
        """H (2, 5): where the truth lies, right and up of the measured ray, by the nuisances.

        They are the bias about east, north and up, and the aim's error right and up.
        """
        return np.column_stack([np.stack([self.axes[1], -self.axes[0]]), np.eye(2)])


@dataclass(frozen=True, slots=True)
class Cloud:
    """The weighted particles' moments: mean (3,) in ENU, covariance (3, 3), effective number, mean bias (3,)."""

    mean_enu_m: FloatArray
    covariance_enu_m2: FloatArray
    effective: float
    bias_rad: FloatArray


class CalibratedFilter:
    """N weighted particles of one static target; every array is made at construction.

    The attitude's bias about east, north and up is a Gauss-Markov process: R_enu_from_cam as reported is exp(bias)
    times the true one.
    """

    def __init__(
        self, n_particles: int, rng: np.random.Generator, range_m: tuple[float, float] = (50.0, 30_000.0)
    ) -> None:
        self.n_particles = n_particles
        self.cloud = Cloud(np.zeros(3), np.zeros((3, 3)), 0.0, np.zeros(3))
        self._rng, self._range_m = rng, range_m
        self._origin_enu_m = np.zeros(3)
        self._stamp_s = 0.0
        self._bias_variance = np.zeros((3, 3))
        self._widest_variance = np.zeros((3, 3))  # of late
        self._aim_sigma_rad = np.zeros(2)
        self._P = np.zeros((_NUISANCES, _NUISANCES))  # covariance of bias and aim given a position; common to all
        self._p = np.zeros((3, n_particles), np.float32)  # positions about the origin
        self._m = np.zeros((_NUISANCES, n_particles), np.float32)  # means of bias and aim
        self._w = np.full(n_particles, 1.0 / n_particles, np.float32)
        self._spare_p, self._spare_m = np.empty_like(self._p), np.empty_like(self._m)
        self._log = np.empty(n_particles, np.float32)
        self._cumulative = np.empty(n_particles)
        self._buffers = [np.empty(_NUISANCES * min(_BLOCK, n_particles), np.float32) for _ in range(3)]
        self._blocks = [slice(i, min(i + _BLOCK, n_particles)) for i in range(0, n_particles, _BLOCK)]
        self._sample = slice(0, n_particles, max(1, n_particles // _SAMPLE))

    def start(
        self, sight: Sight, errors: PoseErrors, prior: Prior | None = None, aim_sigma_rad: FloatArray | None = None
    ) -> None:
        """Spread the particles along the ray, uniform in the logarithm of the range, across it as it is uncertain.

        `prior` weighs them by what else is known of where the target can be. `aim_sigma_rad` (2,) is that of the aim's
        error right and up; none if not given.
        """
        self._origin_enu_m, self._stamp_s = sight.position_enu_m.copy(), sight.stamp_s
        self._bias_variance = self._widest_variance = _bias_variance(errors)
        H = sight.by_nuisance
        unknown = np.zeros((_NUISANCES, _NUISANCES))
        self._aim_sigma_rad = np.zeros(2) if aim_sigma_rad is None else aim_sigma_rad
        unknown[:3, :3], unknown[3:, 3:] = self._bias_variance, np.diag(np.square(self._aim_sigma_rad))
        S = H @ unknown @ H.T + sight.covariance
        gain = unknown @ H.T @ np.linalg.inv(S)
        self._P = unknown - gain @ H @ unknown
        low, high = np.log(self._range_m)
        root = np.linalg.cholesky(S).astype(np.float32)
        axes, gain32 = sight.axes.astype(np.float32), gain.astype(np.float32)
        for block in self._blocks:
            size = block.stop - block.start
            across = root @ self._rng.standard_normal((2, size), dtype=np.float32)
            rank = (np.arange(block.start, block.stop) + self._rng.random(size)) / self.n_particles
            depth = np.exp(low + (high - low) * rank).astype(np.float32)
            np.matmul(axes.T, np.vstack([across * depth, depth]), out=self._p[:, block])
            np.matmul(gain32, across, out=self._m[:, block])
        self._w.fill(1.0 / self.n_particles)
        if prior is not None:
            for block in self._blocks:
                self._log[block] = prior(self._p[:, block] + self._origin_enu_m[:, None])
            self._weigh()
        self._measure()
        if self.cloud.effective < self.n_particles / 2.0:
            self._resample(sight)

    def predict(self, stamp_s: float, errors: PoseErrors) -> None:
        """Let the bias forget itself until a time; the target stands still.

        Where the errors are larger than they have been lately, the autopilot's estimate may have jumped by as much.
        """
        kept = float(np.exp(-max(0.0, stamp_s - self._stamp_s) / errors.bias_time_constant_s))
        self._stamp_s = max(stamp_s, self._stamp_s)
        variance = _bias_variance(errors)
        jump = np.maximum(variance - self._widest_variance, 0.0)
        self._widest_variance = variance + kept**2 * np.maximum(self._widest_variance - variance, 0.0)
        self._bias_variance = variance
        self._forget(slice(0, 3), np.full(3, kept), (1.0 - kept**2) * variance + jump)

    def turn(self, kept: float, aim_sigma_rad: FloatArray) -> None:
        """The target is seen from another side: of the aim's error a share is kept, the rest is new.

        `aim_sigma_rad` (2,) is its size now: what is kept grows with it, for it is a share of what the target looks.
        """
        before = self._aim_sigma_rad
        growth = np.divide(aim_sigma_rad, before, out=np.zeros(2), where=before > 0.0)
        share = np.where(growth > 0.0, kept, 0.0)
        self._forget(slice(3, 5), kept * growth, np.diag((1.0 - share**2) * np.square(aim_sigma_rad)))
        self._aim_sigma_rad = aim_sigma_rad

    def _forget(self, part: slice, kept: FloatArray, new: FloatArray) -> None:
        """Multiply these nuisances by `kept` (k,) and add `new` (k, k) to their covariance."""
        if (kept != 1.0).any():
            self._m[part] *= kept.astype(np.float32)[:, None]
            self._P[part] *= kept[:, None]
            self._P[:, part] *= kept
        self._P[part, part] += new

    def log_likelihood(self, sight: Sight) -> float:
        """Logarithm of a sight's density, in tangents, from a sample of the particles; minus infinity at the least."""
        H = sight.by_nuisance
        S = H @ self._P @ H.T + sight.covariance
        innovations, in_front = self._innovations(self._sample, sight)
        white = np.linalg.solve(np.linalg.cholesky(S), innovations.astype(np.float64))
        weights = self._w[self._sample].astype(np.float64)
        density = np.where(in_front, np.exp(-0.5 * np.square(white).sum(axis=0)), 0.0) @ weights / weights.sum()
        with np.errstate(divide="ignore"):
            return float(np.log(density) - np.log(2.0 * np.pi) - 0.5 * np.linalg.slogdet(S)[1])

    def doubt_attitude(self) -> None:
        """The attitude may have jumped by as much as it is ever wrong."""
        self._P[:3, :3] += self._bias_variance

    def turn_bias(self, by_rad: FloatArray) -> None:
        """The reported attitude, and so its bias, jumped by a rotation vector (3,) about east, north and up."""
        self._m[:3] += by_rad.astype(np.float32)[:, None]
        self._measure()

    def doubt_aim(self, sigma_rad: float) -> None:
        """What is aimed at may have moved on the target by an angle: to a filter the same as a turn of the camera."""
        self._P[:3, :3] += sigma_rad**2 * np.eye(3)

    def innovation_squared(self, sight: Sight) -> float:
        """A sight's distance from what is expected, squared, in units of its covariance: about 2 if all is well."""
        innovations, _ = self._innovations(self._sample, sight)
        weights = self._w[self._sample].astype(np.float64)
        weights /= weights.sum()
        mean = innovations @ weights
        centred = innovations - mean[:, None]
        H = sight.by_nuisance
        covariance = (centred * weights) @ centred.T + H @ self._P @ H.T + sight.covariance
        return float(mean @ np.linalg.solve(covariance, mean))

    @property
    def bias_sigma_rad(self) -> float:
        """One standard deviation of bias and aim about their worst axis, given a position."""
        return float(np.sqrt(max(float(np.linalg.eigvalsh(self._P)[-1]), 0.0)))

    def spread_enu_m(self) -> FloatArray:
        """A few hundred of the particles (3, n), whatever their weights: about how far they reach."""
        part = slice(0, self.n_particles, max(1, self.n_particles // _SPREAD))
        return self._p[:, part] + self._origin_enu_m[:, None]

    def sample_enu_m(self) -> FloatArray:
        """Equally likely positions (3, n) that stand for the cloud."""
        weights = self._w[self._sample].astype(np.float64)
        chosen = systematic_indices(weights, np.random.default_rng(0))
        return np.asarray(self._p[:, self._sample][:, chosen] + self._origin_enu_m[:, None])

    def weighted_sample(self) -> tuple[FloatArray, FloatArray]:
        """Positions (3, n) in ENU and their weights (n,), which sum to 1: every so many-th particle."""
        weights = self._w[self._sample].astype(np.float64)
        return self._p[:, self._sample] + self._origin_enu_m[:, None], weights / weights.sum()

    def snapshot(self) -> FilterSnapshot:
        """What is known, by an equally weighted sample. The same at each call: it takes no random number."""
        n = min(_SAMPLE, self.n_particles)
        total = self._accumulate()
        chosen = np.searchsorted(self._cumulative, (np.arange(n) + 0.5) * (total / n), side="right")
        np.minimum(chosen, self.n_particles - 1, out=chosen)
        return FilterSnapshot(
            stamp_s=self._stamp_s,
            origin_enu_m=self._origin_enu_m.copy(),
            positions_m=self._p[:, chosen],
            nuisances=self._m[:, chosen],
            nuisance_covariance=(self._P + self._P.T) / 2.0,
            bias_variance=self._bias_variance.copy(),
            widest_variance=self._widest_variance.copy(),
            aim_sigma_rad=self._aim_sigma_rad.copy(),
        )

    def restore(self, saved: FilterSnapshot, sight: Sight) -> None:
        """Go on from a snapshot: its particles, copied and spread about the camera of the last `sight`."""
        self._origin_enu_m, self._stamp_s = saved.origin_enu_m.copy(), saved.stamp_s
        self._bias_variance, self._widest_variance = saved.bias_variance.copy(), saved.widest_variance.copy()
        self._P, self._aim_sigma_rad = saved.nuisance_covariance.copy(), saved.aim_sigma_rad.copy()
        n = saved.positions_m.shape[1]
        for block in self._blocks:
            chosen = np.arange(block.start, block.stop) * n // self.n_particles
            self._p[:, block], self._m[:, block] = saved.positions_m[:, chosen], saved.nuisances[:, chosen]
        self._w.fill(1.0 / self.n_particles)
        self._measure()
        self._regularise(sight)
        self._measure()

    def update(self, sight: Sight) -> None:
        """Weigh by the sight, move the bias' means, and resample where the effective number falls under N / 2."""
        H = sight.by_nuisance
        S = H @ self._P @ H.T + sight.covariance
        gain = self._P @ H.T @ np.linalg.inv(S)
        whiten = (np.linalg.inv(np.linalg.cholesky(S)) * np.sqrt(0.5)).astype(np.float32)
        gain32 = gain.astype(np.float32)
        for block in self._blocks:
            innovations, in_front = self._innovations(block, sight)
            correction = np.matmul(gain32, innovations, out=self._scratch(1, _NUISANCES, innovations.shape[1]))
            self._m[:, block] += correction
            white = np.matmul(whiten, innovations, out=correction[:2])
            np.square(white, out=white)
            log = np.add(white[0], white[1], out=self._log[block])
            np.negative(log, out=log)
            log[~in_front] = -np.inf
        self._P = self._P - gain @ H @ self._P
        self._weigh()
        self._measure()
        if self.cloud.effective < self.n_particles / 2.0:
            self._resample(sight)

    def _weigh(self) -> None:
        """Multiply the weights by exp of `_log`, and make them sum to 1 again."""
        best = max(float(self._log[block].max()) for block in self._blocks)
        if best == -np.inf:  # no particle can be where it was seen: nothing learnt
            return
        total = 0.0
        for block in self._blocks:
            log = self._log[block]
            log -= np.float32(best)
            np.exp(log, out=log)
            weights = self._w[block]
            weights *= log
            total += float(weights.sum())
        if total > 0.0:
            self._w *= np.float32(1.0 / total)
        else:
            self._w.fill(1.0 / self.n_particles)

    def _innovations(self, part: slice, sight: Sight) -> tuple[Float32Array, NDArray[np.bool_]]:
        """u(p) - H m (2, B), which the next call overwrites, and which particles (B,) are in front of the camera."""
        axes = sight.axes.astype(np.float32)
        shift = (sight.axes @ (self._origin_enu_m - sight.position_enu_m)).astype(np.float32)
        p, m = self._p[:, part], self._m[:, part]
        q = np.matmul(axes, p, out=self._scratch(0, 3, p.shape[1]))
        q += shift[:, None]
        in_front = q[2] > 1.0
        np.maximum(q[2], 1.0, out=q[2])
        q[:2] /= q[2]
        q[:2] -= np.matmul(sight.by_nuisance.astype(np.float32), m, out=self._scratch(1, 2, p.shape[1]))
        return q[:2], in_front

    def _scratch(self, number: int, rows: int, n: int) -> Float32Array:
        """One of three contiguous arrays (rows, n), rows <= 5 and n at most a block, for a block's own results."""
        return self._buffers[number][: rows * n].reshape(rows, n)

    def _measure(self) -> None:
        reference = (self.cloud.mean_enu_m - self._origin_enu_m).astype(np.float32)
        first, second, bias, squared = np.zeros(3), np.zeros((3, 3)), np.zeros(_NUISANCES), 0.0
        for block in self._blocks:
            weights = self._w[block]
            centred = np.subtract(self._p[:, block], reference[:, None], out=self._scratch(0, 3, weights.size))
            weighted = np.multiply(centred, weights, out=self._scratch(1, 3, weights.size))
            first += centred @ weights
            second += weighted @ centred.T
            bias += self._m[:, block] @ weights
            squared += float(weights @ weights)
        mean = self._origin_enu_m + reference + first
        self.cloud = Cloud(mean, second - np.outer(first, first), 1.0 / max(squared, 1e-30), bias[:3])

    def _accumulate(self) -> float:
        """Sum up the weights in `_cumulative`; their total."""
        total = 0.0
        for block in self._blocks:
            np.cumsum(self._w[block], dtype=np.float64, out=self._cumulative[block])
            self._cumulative[block] += total
            total = float(self._cumulative[block.stop - 1])
        return total

    def _resample(self, sight: Sight) -> None:
        total = self._accumulate()
        start, step = self._rng.random(), total / self.n_particles
        for block in self._blocks:
            points = np.arange(block.start, block.stop, dtype=np.float64)
            points += start
            points *= step
            chosen = np.searchsorted(self._cumulative, points, side="right")
            for values, copies in ((self._p, self._spare_p), (self._m, self._spare_m)):
                for row, copy in zip(values, copies, strict=True):
                    np.take(row, chosen, out=copy[block], mode="clip")
        self._p, self._spare_p = self._spare_p, self._p
        self._m, self._spare_m = self._spare_m, self._m
        self._w.fill(1.0 / self.n_particles)
        self._regularise(sight)
        self._measure()

    def _regularise(self, sight: Sight) -> None:
        """Spread copies by a Gaussian kernel that keeps mean and covariance (Liu and West 2001).

        In coordinates about the camera: tangents right and up, logarithm of the depth. A particle's mean of the bias
        follows its move by their regression on the cloud, for it is a function of the position.
        """
        axes = sight.axes.astype(np.float32)
        shift = (sight.axes @ (self._origin_enu_m - sight.position_enu_m)).astype(np.float32)[:, None]
        x = self._spare_p
        first, second, cross, bias_sum = np.zeros(3), np.zeros((3, 3)), np.zeros((_NUISANCES, 3)), np.zeros(_NUISANCES)
        reference: FloatArray | None = None
        for block in self._blocks:
            q = x[:, block]
            np.matmul(axes, self._p[:, block], out=q)
            q += shift
            np.maximum(q[2], 1.0, out=q[2])
            q[:2] /= q[2]
            np.log(q[2], out=q[2])
            if reference is None:
                reference = q.mean(axis=1, dtype=np.float64)
            q -= reference.astype(np.float32)[:, None]
            m = self._m[:, block]
            first += q.sum(axis=1)
            second += q @ q.T
            cross += m @ q.T
            bias_sum += m.sum(axis=1)
        assert reference is not None
        n = float(self.n_particles)
        mean = first / n
        values, vectors = np.linalg.eigh(second / n - np.outer(mean, mean))
        values = np.maximum(
            values, 1e-6 * values[2] + 1e-14
        )  # few ancestors leave a flat cloud, rounding less than none
        slope = (cross / n - np.outer(bias_sum / n, mean)) @ (vectors / values @ vectors.T)
        root = (_KERNEL * vectors * np.sqrt(values)).astype(np.float32)
        slope32, centre = slope.astype(np.float32), mean.astype(np.float32)[:, None]
        shrink = np.float32(np.sqrt(1.0 - _KERNEL**2) - 1.0)
        back = reference.astype(np.float32)[:, None]
        for block in self._blocks:
            q = x[:, block]
            move, noise = (self._scratch(number, 3, q.shape[1]) for number in (0, 1))
            np.subtract(q, centre, out=move)
            move *= shrink
            self._rng.standard_normal(dtype=np.float32, out=noise)
            move += np.matmul(root, noise, out=self._scratch(2, 3, q.shape[1]))
            self._m[:, block] += np.matmul(slope32, move, out=self._scratch(2, _NUISANCES, q.shape[1]))
            q += move
            q += back
            np.exp(q[2], out=q[2])
            q[:2] *= q[2]
            q -= shift
            np.matmul(axes.T, q, out=self._p[:, block])


def _bias_variance(errors: PoseErrors) -> FloatArray:
    return np.diag(np.square([errors.tilt_bias_rad, errors.tilt_bias_rad, errors.heading_bias_rad]))
