"""Particle filters over many static points, stepped together, with the attitude's slow error as a linear nuisance.

Rao-Blackwellised (Doucet et al. 2000): each particle carries a position and the mean of the attitude error given it,
and all of one target share one covariance of that error, for a small rotation moves what the camera sees by the same
angle at any range. A compass that is wrong for minutes then widens the cloud instead of moving it.

What a step costs is Python for each call more than particles, so each call takes all targets that it is about: their
places (k,) in the arrays, rising where particles are changed. The tracker calls it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.filter.densities import View, densities, log_posterior, whitening
from distloc.filter.moments import Sums
from distloc.filter.particles import SPREAD, Particles, Places
from distloc.filter.platforms import Names, Slots, kept_until
from distloc.filter.start import Cone, Prior, spread_along
from distloc.sights.sight import NUISANCES, STATE, Sight, Sights
from distloc.types import AttitudeError, BoolArray, FloatArray, PoseErrors

_LEAST_LIKELIHOOD = 1e-6  # of a sight: with less the weights might vanish
_LEAST_SCALE = 1e-3
_MOST_FOUND = 6.3  # a squared distance of 3 degrees of freedom: more in 1 of 10 by chance, and little is lost then
_COMPARED = 1024  # particles that tell how likely a sight is
_PAIRS = 16  # compared at a time: what is copied of them stays in the cache


@dataclass(frozen=True, slots=True)
class Fit:
    """How k sights fit what k targets are expected to look like.

    The density's logarithm (k,); in tangents how far off (k, 2), its covariance (k, 2, 2) and its square (k,) by that.
    """

    log_likelihood: FloatArray
    innovation: FloatArray
    covariance: FloatArray
    squared: FloatArray


class Bank:
    """Places for so many targets with `n` weighted particles each; every array is made at construction.

    The attitude's bias about east, north and up is a Gauss-Markov process: R_enu_from_cam as reported is exp(bias)
    times the true one. `P` (places, N, N) is the covariance of bias and aim given a position, common to a place's
    particles; of several `platforms` each has a bias, that of the one that looks first, then the aim, then the others'.
    """

    def __init__(
        self, places: int, n: int, rng: np.random.Generator, range_m: tuple[float, float], platforms: int = 1
    ) -> None:
        self.places = places
        self._rngs = rng.spawn(places)
        self.names, self._slots = Names(platforms), Slots(places, platforms)
        self.particles = Particles(places, n, self._rngs, self._slots)
        self.P = np.zeros((places, self._slots.nuisances, self._slots.nuisances))
        self.aim_sigma_rad = np.zeros((places, 2))
        # of the platform that looks
        self.stamp_s, self.bias_variance = self._slots.stamp_s[:, 0], self._slots.bias_variance[:, 0]
        self.widest_variance = self._slots.widest_variance[:, 0]  # of late
        self._range_m = range_m

    def board(self, places: Places, platform: str) -> None:
        """From now on it is this platform's camera that looks at these targets. ValueError for one name too many."""
        number = self.names.number(platform)
        if self._slots.platforms == 1:
            return
        slots = self._slots.of(places, number)
        for slot in sorted(set(slots.tolist()) - {0}):
            some, order = places[slots == slot], self._slots.swap(places[slots == slot], slot)
            self.P[some] = self.P[some][:, order][:, :, order]
            self.particles.swap(some, order)

    def clear(self, place: int, platform: str | None = None) -> None:
        """A new target, at which no platform has looked yet; the one that is named begins."""
        self._slots.begin(place, None if platform is None else self.names.number(platform))
        self.P[place] = 0.0
        self.particles.scale[place] = 1.0

    def start(
        self,
        place: int,
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
        particles, places = self.particles, np.array([place])
        self.clear(place)
        particles.origin_enu_m[place], self.stamp_s[place] = sight.position_enu_m, sight.stamp_s
        variance = errors.bias_variance if attitude is None else attitude.covariance
        self.bias_variance[place] = self.widest_variance[place] = variance
        self.aim_sigma_rad[place] = 0.0 if aim_sigma_rad is None else aim_sigma_rad
        H = Sights.of([sight]).by_nuisance[0]
        unknown = np.zeros((NUISANCES, NUISANCES))
        unknown[:3, :3], unknown[3:, 3:] = variance, np.diag(np.square(self.aim_sigma_rad[place]))
        S = H @ unknown @ H.T + sight.covariance
        gain = unknown @ H.T @ np.linalg.inv(S)
        self.P[place, :NUISANCES, :NUISANCES] = unknown - gain @ H @ unknown
        spread_along(
            Cone(sight.axes, np.linalg.cholesky(S), gain), particles, place, self._range_m, prior, self._rngs[place]
        )
        particles.measure(places)
        self._slots.saw(places, sight.axes[None], sight.position_enu_m)
        particles.resample_where_few(places, sight.axes[None], sight.position_enu_m)

    def predict(self, places: Places, stamp_s: float, errors: PoseErrors) -> None:
        """Let the bias forget itself until a time; where it may be larger than lately, it may have jumped so far."""
        before_s = self.stamp_s[places]
        kept = kept_until(stamp_s, before_s, errors.bias_time_constant_s)
        self.stamp_s[places] = np.maximum(stamp_s, before_s)
        variance, widest, squared = errors.bias_variance, self.widest_variance[places], np.square(kept)[:, None, None]
        # all is new where it looks for the first time
        jump = np.maximum(variance - widest, 0.0) * np.isfinite(before_s)[:, None, None]
        self.widest_variance[places] = variance + squared * np.maximum(widest - variance, 0.0)
        self.bias_variance[places] = variance
        self._forget(places, slice(0, 3), np.repeat(kept[:, None], 3, axis=1), (1.0 - squared) * variance + jump)

    def follow(self, places: Places, stamp_s: float, attitude: AttitudeError) -> BoolArray:
        """The same where it is known what the bias keeps of itself and what is new.

        Where the bias is found, the particles are weighed by it and keep what is left of it. False (k,) where it cannot
        be what they expect: only the bias is then what is told.
        """
        is_first = ~np.isfinite(self.stamp_s[places])
        self.stamp_s[places] = np.maximum(stamp_s, self.stamp_s[places])
        if is_first.any():
            return self._followed_first(places, is_first, stamp_s, attitude)
        self._mix(places, attitude.kept, attitude.new)
        self.bias_variance[places] = self.widest_variance[places] = attitude.covariance
        if attitude.found_rad is None:
            return np.ones(places.size, np.bool_)
        S = self.P[places, :3, :3] + attitude.covariance
        mean, spread = self.particles.off_bias(places, attitude.found_rad)
        squared = (mean * np.linalg.solve(S + spread, mean[:, :, None])[:, :, 0]).sum(axis=1)
        is_expected = ~(squared > _MOST_FOUND)
        self._mix(places[~is_expected], np.zeros((3, 3)), attitude.covariance)
        for place, S_one in zip(places[is_expected].tolist(), S[is_expected], strict=True):
            P = self.P[place]
            gain = P[:, :3] @ np.linalg.inv(S_one)
            self.particles.find_bias(place, attitude.found_rad, np.linalg.inv(np.linalg.cholesky(S_one)), gain)
            self.P[place] = P - gain @ P[:3]
        return np.asarray(is_expected)

    def _followed_first(
        self, places: Places, is_first: BoolArray, stamp_s: float, attitude: AttitudeError
    ) -> BoolArray:
        """The same where some (k,) have not been looked at by this platform: all is new of its bias."""
        first, is_expected = places[is_first], np.ones(places.size, np.bool_)
        self._mix(first, np.zeros((3, 3)), attitude.covariance)
        self.bias_variance[first] = self.widest_variance[first] = attitude.covariance
        if not is_first.all():
            is_expected[~is_first] = self.follow(places[~is_first], stamp_s, attitude)
        return is_expected

    def turn(self, places: Places, kept: FloatArray, aim_sigma_rad: FloatArray, grows: BoolArray | bool = True) -> None:
        """The targets are seen from another side: of an aim's error a share (k, 2) is kept, the rest is new.

        `aim_sigma_rad` (k, 2) is its size now: where it `grows` (k, 2) what is kept grows with it, for it is a share of
        what the target looks; else at most to that size.
        """
        before = self.aim_sigma_rad[places]
        growth = np.divide(aim_sigma_rad, before, out=np.zeros_like(before), where=before > 0.0)
        share = kept * np.where(grows, growth, np.minimum(growth, 1.0))
        new = np.zeros((places.size, 2, 2))
        new[:, [0, 1], [0, 1]] = np.square(aim_sigma_rad) - np.square(share * before)
        self._forget(places, slice(3, 5), share, new)
        self.aim_sigma_rad[places] = aim_sigma_rad

    def compare(self, places: NDArray[np.intp], sights: Sights) -> Fit:
        """Each sight with the target at its place, from a sample of the particles; a place may come often."""
        k = places.size
        fit = Fit(np.full(k, -np.inf), np.zeros((k, 2)), np.zeros((k, 2, 2)), np.zeros(k))
        for start in range(0, k, _PAIRS):
            part = slice(start, start + _PAIRS)
            self._compare(fit, part, places[part], sights.chosen(np.arange(k)[part]))
        return fit

    def update(self, places: Places, sights: Sights) -> None:
        """Weigh by the sights, move the nuisances' means, and resample where the effective number falls under half.

        A sight in front of which no particle is tells nothing.
        """
        P, H, particles = self.P[places], sights.by_nuisance, self.particles
        seen = P[:, :NUISANCES]
        whiten = whitening(H @ seen[:, :, :NUISANCES] @ H.swapaxes(1, 2) + sights.covariance)
        view = self._view(places, sights, whiten)
        best = self._best_where_unlikely(places, view)
        is_told = best > -np.inf
        if not is_told.all():
            if is_told.any():
                self.update(places[is_told], sights.chosen(is_told))
            return
        gain = P[:, :, :NUISANCES] @ H.swapaxes(1, 2) @ whiten.swapaxes(1, 2)  # for whitened innovations
        self.P[places] = P - gain @ whiten @ H @ seen
        gain32 = (gain / particles.scale[places, :, None]).astype(np.float32)
        sums = Sums(places.size)
        for block in particles.blocks(places):
            x, weights = particles.of(block)
            white, in_front = view.at(block.at).innovations(x[:, :STATE], particles.scratch(0, 5, weights))
            moves = np.matmul(gain32[block.at], white, out=particles.scratch(1, P.shape[1], weights))
            x[:, 3:] += moves
            if not best[block.at].any():
                weights *= densities(white, in_front)
            else:
                log = log_posterior(weights, white, in_front)
                np.exp(log - best[block.at, None].astype(np.float32), out=weights)
            sums.add(block.at, x, weights, particles.scratch(2, 3, weights))
        shares = (1.0 / sums.weight).astype(np.float32)
        for block in particles.blocks(places):
            particles.of(block)[1][:] *= shares[block.at, None]
        particles.take_in(places, sums)
        self._slots.saw(places, sights.axes, sights.position_enu_m)
        particles.resample_where_few(places, sights.axes, sights.position_enu_m)

    def seen_sigma_rad(self, places: Places, camera_enu_m: FloatArray) -> FloatArray:
        """One standard deviation (k,) of what bias and aim, given a position, move what is seen of a target by."""
        along = self.particles.clouds.mean_enu_m[places] - camera_enu_m
        along /= np.maximum(np.linalg.norm(along, axis=1), 1.0)[:, None]
        across = np.eye(3) - along[:, :, None] * along[:, None, :]
        P = self.P[places]
        # a rotation about the line of sight moves nothing
        variance = np.trace(across @ P[:, :3, :3], axis1=1, axis2=2) + np.trace(
            P[:, 3:NUISANCES, 3:NUISANCES], axis1=1, axis2=2
        )
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    def _forget(self, places: Places, part: slice, kept: FloatArray, new: FloatArray) -> None:
        """Multiply these nuisances by `kept` (k, j) and add `new` (k, j, j) to their covariance."""
        scale = self.particles.scale[places]
        scale[:, part] *= kept
        self.particles.scale[places] = scale
        P = self.P[places]
        P[:, part] *= kept[:, :, None]
        P[:, :, part] *= kept[:, None, :]
        P[:, part, part] += new
        self.P[places] = P
        for place in places[scale.min(axis=1) < _LEAST_SCALE].tolist():
            self.particles.rescale(place)

    def _mix(self, places: Places, kept: FloatArray, new: FloatArray) -> None:
        self.particles.mix_bias(places, kept)
        P = self.P[places]
        P[:, :3] = kept @ P[:, :3]
        P[:, :, :3] = P[:, :, :3] @ kept.T
        P[:, :3, :3] += new
        self.P[places] = P

    def _compare(self, fit: Fit, part: slice, places: NDArray[np.intp], sights: Sights) -> None:
        H = sights.by_nuisance
        x, weights = self.particles.sampled(places, _COMPARED)
        innovations, in_front = self._view(places, sights, None).innovations(x)
        column = weights[:, :, None]
        mean = innovations @ column
        centred = innovations - mean
        S = H @ self.P[places, :NUISANCES, :NUISANCES] @ H.swapaxes(1, 2) + sights.covariance
        whiten = whitening(S)
        fit.innovation[part] = mean[:, :, 0]
        fit.covariance[part] = expected = (centred * weights[:, None, :]) @ centred.swapaxes(1, 2) + S
        fit.squared[part] = np.square(whitening(expected) @ mean).sum(axis=(1, 2))
        white = whiten.astype(np.float32) @ innovations
        likelihood = (densities(white, in_front)[:, None, :].astype(np.float64) @ column)[:, 0, 0]
        with np.errstate(divide="ignore"):
            fit.log_likelihood[part] = np.log(likelihood * whiten[:, 0, 0] * whiten[:, 1, 1] / (2.0 * np.pi))

    def _best_where_unlikely(self, places: Places, view: View) -> FloatArray:
        """The greatest logarithm (k,) of weight times exp(-d^2 / 2) where the product of the two might vanish, else 0.

        Minus infinity where no particle can be there.
        """
        x, weights = self.particles.sampled(places, SPREAD)
        likelihood = (densities(*view.innovations(x)) * weights).sum(axis=1)
        best = np.zeros(places.size)
        for at in np.flatnonzero(~(likelihood > _LEAST_LIKELIHOOD)):
            best[at] = -np.inf
            for block in self.particles.blocks(places[at : at + 1]):
                x, weights = self.particles.of(block)
                log = log_posterior(weights, *view.at(slice(at, at + 1)).innovations(x[:, :STATE]))
                best[at] = max(best[at], float(log.max()))
        return best

    def _view(self, places: NDArray[np.intp], sights: Sights, whiten: FloatArray | None) -> View:
        """`whiten` (k, 2, 2) is from tangents right and up to the unit wanted; None for tangents."""
        particles, from_enu, by_nuisance = self.particles, sights.axes, sights.by_nuisance
        if whiten is not None:
            from_enu, by_nuisance = from_enu.copy(), whiten @ by_nuisance
            from_enu[:, :2] = whiten @ from_enu[:, :2]
        A = np.zeros((places.size, 5, STATE), np.float32)
        A[:, :3, :3], A[:, 3:, 3:] = from_enu, by_nuisance * particles.scale[places, None, :NUISANCES]
        shift = from_enu @ (particles.origin_enu_m[places] - sights.position_enu_m)[:, :, None]
        return View(A, shift.astype(np.float32))
