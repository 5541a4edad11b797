"""One target of a bank of filters, for what is done to one at a time; its track holds it."""

import numpy as np

from distloc.filter.bank import Bank
from distloc.filter.moments import Cloud
from distloc.filter.start import Prior
from distloc.sights.sight import NUISANCES, Sight, Sights
from distloc.snapshot import FilterSnapshot
from distloc.types import AttitudeError, BoolArray, FloatArray, PoseErrors


class CalibratedFilter:
    """The filter at one place of a bank."""

    def __init__(self, bank: Bank, place: int) -> None:
        self.bank, self.place = bank, place
        self._places = np.array([place])

    def board(self, platform: str) -> None:
        """From now on it is this platform's camera that looks. ValueError for one name too many."""
        self.bank.board(self._places, platform)

    def clear(self, platform: str) -> None:
        """A new target, which this platform's camera sees first. ValueError for one name too many."""
        self.bank.clear(self.place, platform)

    @classmethod
    def alone(
        cls,
        n_particles: int,
        rng: np.random.Generator,
        range_m: tuple[float, float] = (50.0, 30_000.0),
        platforms: int = 1,
    ) -> "CalibratedFilter":
        """With a bank of its own."""
        return cls(Bank(1, n_particles, rng, range_m, platforms), 0)

    @property
    def cloud(self) -> Cloud:
        """What the particles sum up to."""
        return self.bank.particles.clouds.one(self.place)

    @property
    def mean_enu_m(self) -> FloatArray:
        """The cloud's (3,)."""
        return np.asarray(self.bank.particles.clouds.mean_enu_m[self.place].copy())

    def start(
        self,
        sight: Sight,
        errors: PoseErrors,
        prior: Prior | None = None,
        aim_sigma_rad: FloatArray | None = None,
        attitude: AttitudeError | None = None,
    ) -> None:
        """Begin with a sight, as the bank does."""
        self.bank.start(self.place, sight, errors, prior, aim_sigma_rad, attitude)

    def predict(self, stamp_s: float, errors: PoseErrors) -> None:
        """Let the bias forget itself until a time."""
        self.bank.predict(self._places, stamp_s, errors)

    def follow(self, stamp_s: float, attitude: AttitudeError) -> bool:
        """The same where it is known what it keeps; False where a bias that is found cannot be what is expected."""
        return bool(self.bank.follow(self._places, stamp_s, attitude)[0])

    def turn(self, kept: FloatArray, aim_sigma_rad: FloatArray, grows: BoolArray | bool = True) -> None:
        """The target is seen from another side: of the aim's error, (2,) now, a share (2,) is kept, which may grow."""
        self.bank.turn(self._places, kept, aim_sigma_rad[None], grows)

    def update(self, sight: Sight) -> None:
        """Weigh by a sight."""
        self.bank.update(self._places, Sights.of([sight]))

    def log_likelihood(self, sight: Sight) -> float:
        """Logarithm of a sight's density, in tangents, from a sample of the particles; minus infinity at the least."""
        return float(self.bank.compare(self._places, Sights.of([sight])).log_likelihood[0])

    def innovation(self, sight: Sight) -> tuple[FloatArray, float]:
        """How far a sight is from what is expected (2,), in tangents, and the square by the covariance of that."""
        fit = self.bank.compare(self._places, Sights.of([sight]))
        return fit.innovation[0], float(fit.squared[0])

    def doubt_attitude(self) -> None:
        """The attitude may have jumped by as much as it is ever wrong."""
        self.bank.P[self.place, :3, :3] += self.bank.bias_variance[self.place]

    def turn_bias(self, by_rad: FloatArray) -> None:
        """The reported attitude, and so its bias, jumped by a rotation vector (3,) about east, north and up."""
        particles, place = self.bank.particles, self.place
        particles.x[place, 3:6] += (by_rad / particles.scale[place, :3]).astype(np.float32)[:, None]
        particles.measure(self._places)

    def doubt_aim(self, sigma_rad: float) -> None:
        """What is aimed at may have moved on the target by an angle: to a filter the same as a turn of the camera."""
        self.bank.P[self.place, :3, :3] += sigma_rad**2 * np.eye(3)

    def positions_enu_m(self) -> FloatArray:
        """Equally likely particles (3, n); the same at each call."""
        particles = self.bank.particles
        return particles.drawn(self.place)[:3] + particles.origin_enu_m[self.place, :, None]

    def snapshot(self) -> FilterSnapshot:
        """What is known, by an equally weighted sample; of the platforms' errors that of the one that looked last.

        The same at each call: it takes no random number.
        """
        bank, place = self.bank, self.place
        drawn, P = bank.particles.drawn(place), bank.P[place, :NUISANCES, :NUISANCES]
        return FilterSnapshot(
            stamp_s=float(bank.stamp_s[place]),
            origin_enu_m=bank.particles.origin_enu_m[place].copy(),
            positions_m=drawn[:3],
            nuisances=drawn[3:],
            nuisance_covariance=(P + P.T) / 2.0,
            bias_variance=bank.bias_variance[place].copy(),
            widest_variance=bank.widest_variance[place].copy(),
            aim_sigma_rad=bank.aim_sigma_rad[place].copy(),
        )

    def restore(self, saved: FilterSnapshot, sight: Sight) -> None:
        """Go on from a snapshot: its particles, copied and spread about the camera of the last `sight`."""
        bank, place = self.bank, self.place
        bank.clear(place)
        bank.particles.origin_enu_m[place], bank.stamp_s[place] = saved.origin_enu_m, saved.stamp_s
        bank.bias_variance[place], bank.widest_variance[place] = saved.bias_variance, saved.widest_variance
        bank.P[place, :NUISANCES, :NUISANCES] = saved.nuisance_covariance
        bank.aim_sigma_rad[place] = saved.aim_sigma_rad
        drawn = np.concatenate([saved.positions_m, saved.nuisances])
        bank.particles.restore(place, drawn, sight.axes, sight.position_enu_m)
