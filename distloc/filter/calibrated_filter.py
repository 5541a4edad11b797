"""A particle filter over a static point, with the attitude's slow error as a conditionally linear nuisance.

Rao-Blackwellised (Doucet et al. 2000): each particle carries a position and the mean of the attitude error given it,
and all share one covariance of that error, for a small rotation moves what the camera sees by the same angle at any
range. A compass that is wrong for minutes then widens the cloud instead of moving it. The tracks call it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.densities import densities, log_posterior, whitening
from distloc.filter.particles import STATE, Cloud, Particles, Sums, Workspace
from distloc.sights.sight import NUISANCES, Sight
from distloc.snapshot import FilterSnapshot, Float32Array
from distloc.types import AttitudeError, BoolArray, FloatArray, PoseErrors

Prior = Callable[[FloatArray], FloatArray]  # logarithms of weights (B,) for positions (3, B) in ENU

_LEAST_LIKELIHOOD = 1e-6  # of a sight: with less the weights might vanish
_LEAST_SCALE = 1e-3
_MOST_FOUND = 6.3  # a squared distance of 3 degrees of freedom: more in 1 of 10 by chance, and little is lost then


@dataclass(frozen=True, slots=True)
class _View:
    """From particles (8, B) by `A` (5, 8) and `shift` (3, 1) to what is right and up of the sight, in its own unit.

    The first two rows are that times the depth, the third is the depth in metres, the last two the nuisances' part.
    """

    A: Float32Array
    shift: Float32Array


class CalibratedFilter:
    """N weighted particles of one static target; every array is made at construction.

    The attitude's bias about east, north and up is a Gauss-Markov process: R_enu_from_cam as reported is exp(bias)
    times the true one.
    """

    def __init__(
        self,
        n_particles: int,
        rng: np.random.Generator,
        range_m: tuple[float, float] = (50.0, 30_000.0),
        workspace: Workspace | None = None,
    ) -> None:
        self.particles = Particles(n_particles, rng, workspace)
        self._rng, self._range_m = rng, range_m
        self._stamp_s = 0.0
        self._bias_variance = np.zeros((3, 3))
        self._widest_variance = np.zeros((3, 3))  # of late
        self._aim_sigma_rad = np.zeros(2)
        self._P = np.zeros((NUISANCES, NUISANCES))  # covariance of bias and aim given a position; common to all

    @property
    def cloud(self) -> Cloud:
        """What the particles sum up to."""
        return self.particles.cloud

    def start(
        self,
        sight: Sight,
        errors: PoseErrors,
        prior: Prior | None = None,
        aim_sigma_rad: FloatArray | None = None,
        attitude: AttitudeError | None = None,
    ) -> None:
        """Spread the particles along the ray, uniform in the logarithm of the range, across it as it is uncertain.

        `prior` weighs them by what else is known of where the target can be. `aim_sigma_rad` (2,) is that of the aim's
        error right and up; none if not given. `attitude` says more of the bias than the errors do.
        """
        self.particles.origin_enu_m, self._stamp_s = sight.position_enu_m.copy(), sight.stamp_s
        self._bias_variance = self._widest_variance = errors.bias_variance if attitude is None else attitude.covariance
        H = sight.by_nuisance
        unknown = np.zeros((NUISANCES, NUISANCES))
        self._aim_sigma_rad = np.zeros(2) if aim_sigma_rad is None else aim_sigma_rad
        unknown[:3, :3], unknown[3:, 3:] = self._bias_variance, np.diag(np.square(self._aim_sigma_rad))
        S = H @ unknown @ H.T + sight.covariance
        gain = unknown @ H.T @ np.linalg.inv(S)
        self._P = unknown - gain @ H @ unknown
        low, high = np.log(self._range_m)
        root = np.linalg.cholesky(S).astype(np.float32)
        axes, gain32 = sight.axes.astype(np.float32), gain.astype(np.float32)
        particles = self.particles
        for block in particles.blocks:
            size = block.stop - block.start
            across = root @ self._rng.standard_normal((2, size), dtype=np.float32)
            rank = (np.arange(block.start, block.stop) + self._rng.random(size)) / particles.n
            depth = np.exp(low + (high - low) * rank).astype(np.float32)
            np.matmul(axes.T, np.vstack([across * depth, depth]), out=particles.x[:3, block])
            np.matmul(gain32, across, out=particles.x[3:, block])
        particles.scale.fill(1.0)
        particles.weights.fill(1.0 / particles.n)
        if prior is not None:
            self._weigh_by(prior)
        particles.measure()
        particles.resample_if_few(sight.axes, sight.position_enu_m)

    def predict(self, stamp_s: float, errors: PoseErrors) -> None:
        """Let the bias forget itself until a time; where it may be larger than lately, it may have jumped so far."""
        kept = float(np.exp(-max(0.0, stamp_s - self._stamp_s) / errors.bias_time_constant_s))
        self._stamp_s = max(stamp_s, self._stamp_s)
        variance = errors.bias_variance
        jump = np.maximum(variance - self._widest_variance, 0.0)
        self._widest_variance = variance + kept**2 * np.maximum(self._widest_variance - variance, 0.0)
        self._bias_variance = variance
        self._forget(slice(0, 3), np.full(3, kept), (1.0 - kept**2) * variance + jump)

    def follow(self, stamp_s: float, attitude: AttitudeError) -> bool:
        """The same where it is known what the bias keeps of itself and what is new.

        Where the bias is found, the particles are weighed by it and keep what is left of it. False where it cannot be
        what they expect: only the bias is then what is told.
        """
        self._stamp_s = max(stamp_s, self._stamp_s)
        self._mix(attitude.kept, attitude.new)
        self._bias_variance = self._widest_variance = attitude.covariance
        if attitude.found_rad is None:
            return True
        S = self._P[:3, :3] + attitude.covariance
        mean, spread = self.particles.off_bias(attitude.found_rad)
        if mean @ np.linalg.solve(S + spread, mean) > _MOST_FOUND:
            self._mix(np.zeros((3, 3)), attitude.covariance)
            return False
        gain = self._P[:, :3] @ np.linalg.inv(S)
        self.particles.find_bias(attitude.found_rad, np.linalg.inv(np.linalg.cholesky(S)), gain)
        self._P = self._P - gain @ self._P[:3]
        return True

    def _mix(self, kept: FloatArray, new: FloatArray) -> None:
        self.particles.mix_bias(kept)
        self._P[:3] = kept @ self._P[:3]
        self._P[:, :3] = self._P[:, :3] @ kept.T
        self._P[:3, :3] += new

    def turn(self, kept: FloatArray, aim_sigma_rad: FloatArray, grows: BoolArray | bool = True) -> None:
        """The target is seen from another side: of the aim's error a share (2,) is kept, the rest is new.

        `aim_sigma_rad` (2,) is its size now: where it `grows` (2,) what is kept grows with it, for it is a share of
        what the target looks; else at most to that size.
        """
        before = self._aim_sigma_rad
        growth = np.divide(aim_sigma_rad, before, out=np.zeros(2), where=before > 0.0)
        share = kept * np.where(grows, growth, np.minimum(growth, 1.0))
        self._forget(slice(3, 5), share, np.diag(np.square(aim_sigma_rad) - np.square(share * before)))
        self._aim_sigma_rad = aim_sigma_rad

    def _forget(self, part: slice, kept: FloatArray, new: FloatArray) -> None:
        """Multiply these nuisances by `kept` (k,) and add `new` (k, k) to their covariance."""
        self.particles.scale[part] *= kept
        self._P[part] *= kept[:, None]
        self._P[:, part] *= kept
        self._P[part, part] += new
        if self.particles.scale.min() < _LEAST_SCALE:
            self.particles.rescale()

    def log_likelihood(self, sight: Sight) -> float:
        """Logarithm of a sight's density, in tangents, from a sample of the particles; minus infinity at the least."""
        H = sight.by_nuisance
        S = H @ self._P @ H.T + sight.covariance
        whiten = whitening(S)
        likelihood = self._likelihood(self._view(sight, whiten)) * float(whiten[0, 0] * whiten[1, 1])
        return math.log(likelihood / (2.0 * math.pi)) if likelihood > 0.0 else -math.inf

    def doubt_attitude(self) -> None:
        """The attitude may have jumped by as much as it is ever wrong."""
        self._P[:3, :3] += self._bias_variance

    def turn_bias(self, by_rad: FloatArray) -> None:
        """The reported attitude, and so its bias, jumped by a rotation vector (3,) about east, north and up."""
        self.particles.x[3:6] += (by_rad / self.particles.scale[:3]).astype(np.float32)[:, None]
        self.particles.measure()

    def doubt_aim(self, sigma_rad: float) -> None:
        """What is aimed at may have moved on the target by an angle: to a filter the same as a turn of the camera."""
        self._P[:3, :3] += sigma_rad**2 * np.eye(3)

    def innovation(self, sight: Sight) -> tuple[FloatArray, FloatArray]:
        """How far a sight is from what is expected (2,), in tangents, and what covariance that has (2, 2)."""
        x, weights = self.particles.sampled()
        innovations, _ = self._innovations(x, self._view(sight, np.eye(2)))
        mean = innovations @ weights
        centred = innovations - mean[:, None]
        H = sight.by_nuisance
        return mean, (centred * weights) @ centred.T + H @ self._P @ H.T + sight.covariance

    @property
    def bias_sigma_rad(self) -> float:
        """One standard deviation of bias and aim about their worst axis, given a position."""
        return float(np.sqrt(max(float(np.linalg.eigvalsh(self._P)[-1]), 0.0)))

    def snapshot(self) -> FilterSnapshot:
        """What is known, by an equally weighted sample. The same at each call: it takes no random number."""
        drawn = self.particles.drawn()
        return FilterSnapshot(
            stamp_s=self._stamp_s,
            origin_enu_m=self.particles.origin_enu_m.copy(),
            positions_m=drawn[:3],
            nuisances=drawn[3:],
            nuisance_covariance=(self._P + self._P.T) / 2.0,
            bias_variance=self._bias_variance.copy(),
            widest_variance=self._widest_variance.copy(),
            aim_sigma_rad=self._aim_sigma_rad.copy(),
        )

    def restore(self, saved: FilterSnapshot, sight: Sight) -> None:
        """Go on from a snapshot: its particles, copied and spread about the camera of the last `sight`."""
        self.particles.origin_enu_m, self._stamp_s = saved.origin_enu_m.copy(), saved.stamp_s
        self._bias_variance, self._widest_variance = saved.bias_variance.copy(), saved.widest_variance.copy()
        self._P, self._aim_sigma_rad = saved.nuisance_covariance.copy(), saved.aim_sigma_rad.copy()
        drawn = np.concatenate([saved.positions_m, saved.nuisances])
        self.particles.restore(drawn, sight.axes, sight.position_enu_m)

    def update(self, sight: Sight) -> None:
        """Weigh by the sight, move the nuisances' means, and resample where the effective number falls under N / 2.

        A sight in front of which no particle is tells nothing.
        """
        H = sight.by_nuisance
        whiten = whitening(H @ self._P @ H.T + sight.covariance)
        gain = self._P @ H.T @ whiten.T  # for whitened innovations
        view = self._view(sight, whiten)
        # by logarithms where the product of weight and density might vanish: then its best comes first
        best = None if self._likelihood(view, is_rough=True) > _LEAST_LIKELIHOOD else self._best(view)
        if best == -math.inf:
            return
        self._P = self._P - gain @ whiten @ H @ self._P
        particles, sums = self.particles, Sums()
        gain32 = (gain / particles.scale[:, None]).astype(np.float32)
        for block in particles.blocks:
            x, weights = particles.x[:, block], particles.weights[block]
            white, in_front = self._innovations(x, view)
            moves = np.matmul(gain32, white, out=particles.workspace.scratch(1, NUISANCES, weights.size))
            x[3:] += moves
            if best is None:
                weights *= densities(white, in_front)
            else:
                np.exp(log_posterior(weights, white, in_front) - np.float32(best), out=weights)
            sums.add(x, weights, moves[:3])
        particles.weights *= np.float32(1.0 / sums.weight)
        particles.cloud = sums.cloud(particles.origin_enu_m, particles.scale)
        particles.resample_if_few(sight.axes, sight.position_enu_m)

    def _weigh_by(self, prior: Prior) -> None:
        particles, weights = self.particles, self.particles.weights
        for block in particles.blocks:
            weights[block] = prior(particles.x[:3, block] + particles.origin_enu_m[:, None])
        best = weights.max()
        if best > -np.inf:
            weights -= best
            np.exp(weights, out=weights)
        else:  # it allows no particle: nothing known
            weights.fill(1.0)
        weights *= np.float32(1.0 / weights.sum(dtype=np.float64))

    def _view(self, sight: Sight, whiten: FloatArray) -> _View:
        """`whiten` (2, 2) is from tangents right and up to the unit wanted."""
        from_enu = np.empty((3, 3))
        from_enu[:2], from_enu[2] = whiten @ sight.axes[:2], sight.axes[2]
        A = np.zeros((5, STATE), np.float32)
        A[:3, :3], A[3:, 3:] = from_enu, whiten @ sight.by_nuisance * self.particles.scale
        shift = from_enu @ (self.particles.origin_enu_m - sight.position_enu_m)
        return _View(A, shift.astype(np.float32)[:, None])

    def _innovations(self, x: Float32Array, view: _View) -> tuple[Float32Array, NDArray[np.bool_] | None]:
        """u(p) - H m (2, B) of particles (8, B), which the next call overwrites.

        With it which particles (B,) are in front of the camera, None if all are.
        """
        seen = np.matmul(view.A, x, out=self.particles.workspace.scratch(0, 5, x.shape[1]))
        seen[:3] += view.shift
        depth = seen[2]
        in_front = None
        if not depth.min() > 1.0:
            in_front = depth > 1.0
            np.maximum(depth, 1.0, out=depth)
        innovations = seen[:2]
        innovations /= depth
        innovations -= seen[3:]
        return innovations, in_front

    def _likelihood(self, view: _View, is_rough: bool = False) -> float:
        """Mean of exp(-d^2 / 2) over a weighted sample of the particles, d being the whitened innovation."""
        x, weights = self.particles.sampled(is_rough)
        return float(densities(*self._innovations(x, view)) @ weights)

    def _best(self, view: _View) -> float:
        """The greatest logarithm of weight times exp(-d^2 / 2); minus infinity where no particle can be there."""
        particles = self.particles
        return max(
            float(log_posterior(particles.weights[block], *self._innovations(particles.x[:, block], view)).max())
            for block in particles.blocks
        )
