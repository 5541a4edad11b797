"""`distloc bench`: how long a filter step takes here, ours beside the paper's filter and its update taken literally.

All fly the paper's scene, a cube 2 km ahead on a perpendicular flight, in turns, so that they see the same machine.
"""

import time
from collections.abc import Callable

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.bootstrap_filter import BootstrapFilter
from distloc.calibrated_filter import CalibratedFilter, Sight
from distloc.camera import Camera
from distloc.detections import detections_from_mask
from distloc.localizer_config import LocalizerConfig
from distloc.sights import ray_of, sight_of
from distloc.study.scenes import PAPER_CAMERA, PAPER_TARGET_ENU_M, paper_scene
from distloc.types import CameraPose, FloatArray
from service.progress import count_progress

N_PARTICLES = 100_000
_WARM_UP = 10  # steps flown before the flight that counts, with filters of their own
_BRUTE_STEPS = 3  # spread over the flight: each takes seconds
_BRUTE_BUDGET_S = 20.0  # a step that takes longer is measured on fewer particles
_TRIAL = 500  # particles that tell how long all will take
_PAIRS = 1 << 18  # of particle and pixel at a time: 2 MB, whatever the mask
_SIGMA_P_M = 5.0  # the paper's


class Timing(msgspec.Struct, frozen=True):
    """One contender: the median of its steps, and that by the calibrated filter's."""

    median_ms: float
    ratio: float
    steps: int


class BruteTiming(Timing, frozen=True):
    """`median_ms` is for all the particles; `particles` of them were timed, fewer where all would take over 20 s."""

    particles: int
    positive_pixels: int


class Bench(msgspec.Struct, frozen=True):
    """What `--json` prints. A median of steps of which there were none is null."""

    n_particles: int
    calibrated: Timing
    calibrated_with_resampling_ms: float | None
    calibrated_without_resampling_ms: float | None
    resampled_steps: int
    bootstrap: Timing
    brute_force_update: BruteTiming
    schema: str = "distloc/bench/1"


def run_bench(as_json: bool, say: Callable[[str], None]) -> None:
    """Measure, and print it."""
    result = bench(N_PARTICLES)
    say(msgspec.json.encode(result).decode() if as_json else _table(result))


def bench(n_particles: int, seed: int = 0) -> Bench:
    """Fly it once: each step of the flight is one round of all contenders."""
    scene = paper_scene()
    poses = [scene.flight.pose_at(float(stamp_s)) for stamp_s in scene.flight.stamps_s]
    _fly(poses[:_WARM_UP], n_particles, seed, lambda done: None)
    with count_progress("bench", len(poses)) as on_done:
        return _result(n_particles, *_fly(poses, n_particles, seed, on_done))


def _fly(
    poses: list[CameraPose], n_particles: int, seed: int, on_done: Callable[[int], None]
) -> tuple["_Calibrated", "_Bootstrap", "_BruteForce"]:
    ours, bootstrap, brute = _Calibrated(n_particles, seed), _Bootstrap(n_particles, seed), _BruteForce(n_particles)
    brute_rounds = {round(index) for index in np.linspace(1, len(poses) - 1, _BRUTE_STEPS)}
    for index, pose in enumerate(poses):
        mask = _mask(pose)
        ours.step(pose, mask)
        bootstrap.step(pose, mask)
        if index in brute_rounds:
            brute.update(pose, mask, bootstrap.filter.particles_enu_m)
        on_done(index + 1)
    return ours, bootstrap, brute


def brute_force_weights(
    camera: Camera, particles_enu_m: FloatArray, pose: CameraPose, mask: NDArray[np.uint8]
) -> FloatArray:
    """The paper's update as it is written: exp(-min d^2) (N,) over all positive pixels of a full-size mask."""
    pixels, visible = camera.project(pose.R_cam_from_enu @ (particles_enu_m - pose.position_enu_m[:, None]))
    rows, columns = np.nonzero(mask)
    u, v = pixels[0, visible], pixels[1, visible]
    squared_px2 = np.full(u.size, np.inf)
    chunk = max(1, _PAIRS // max(rows.size, 1))
    for start in range(0, u.size if rows.size else 0, chunk):
        part = slice(start, start + chunk)
        distances_px2 = np.square(u[part, None] - columns)
        distances_px2 += np.square(v[part, None] - rows)
        squared_px2[part] = distances_px2.min(axis=1)
    weights = np.zeros(particles_enu_m.shape[1])
    weights[visible] = np.exp(-squared_px2)
    return weights


class _Calibrated:
    """Times predict and update; the first sight starts it."""

    def __init__(self, n_particles: int, seed: int) -> None:
        self.filter = CalibratedFilter(n_particles, np.random.Generator(np.random.SFC64(seed)))
        self.times_s: list[float] = []
        self.resampled: list[bool] = []
        self._config = LocalizerConfig()
        self._is_started = False

    def step(self, pose: CameraPose, mask: NDArray[np.uint8]) -> None:
        sight, errors = self._sight(pose, mask), self._config.pose_errors
        if not self._is_started:
            self.filter.start(sight, errors)
            self._is_started = True
            return
        started_s = time.perf_counter()
        self.filter.predict(pose.stamp_s, errors)
        self.filter.update(sight)
        self.times_s.append(time.perf_counter() - started_s)
        # only a cloud that was just resampled has equal weights
        self.resampled.append(self.filter.cloud.effective > 0.999 * self.filter.particles.n)

    def _sight(self, pose: CameraPose, mask: NDArray[np.uint8]) -> Sight:
        detection = detections_from_mask(mask, PAPER_CAMERA)[0]
        range_m = float(np.linalg.norm(PAPER_TARGET_ENU_M - pose.position_enu_m))
        config = self._config
        errors, sigma_px = config.pose_errors, config.pixel_sigma_px
        return sight_of(ray_of(PAPER_CAMERA, pose, detection, config.aim), errors, sigma_px, range_m, None)


class _Bootstrap:
    """Times predict and update of the paper's filter; what starts it is not timed."""

    def __init__(self, n_particles: int, seed: int) -> None:
        rng = np.random.Generator(np.random.SFC64(seed))
        self.filter = BootstrapFilter(PAPER_CAMERA, n_particles, _SIGMA_P_M, rng)
        self.times_s: list[float] = []

    def step(self, pose: CameraPose, mask: NDArray[np.uint8]) -> None:
        if not self.filter.is_started:
            self.filter.step(pose, mask)
            return
        started_s = time.perf_counter()
        self.filter.predict()
        self.filter.update(pose, mask)
        self.times_s.append(time.perf_counter() - started_s)


class _BruteForce:
    """Times the weights alone: no prediction, no resampling."""

    def __init__(self, n_particles: int) -> None:
        self.particles = n_particles
        self.positive_pixels = 0
        self.times_s: list[float] = []
        self._n_particles = n_particles

    def update(self, pose: CameraPose, mask: NDArray[np.uint8], particles_enu_m: FloatArray) -> None:
        self.positive_pixels = cv2.countNonZero(mask)
        if not self.times_s:
            trial = min(_TRIAL, self._n_particles)
            share = _BRUTE_BUDGET_S / max(self._timed_s(pose, mask, particles_enu_m, trial), 1e-9)
            self.particles = max(trial, min(self._n_particles, int(trial * share)))
        taken_s = self._timed_s(pose, mask, particles_enu_m, self.particles)
        self.times_s.append(taken_s * self._n_particles / self.particles)

    @staticmethod
    def _timed_s(pose: CameraPose, mask: NDArray[np.uint8], particles_enu_m: FloatArray, number: int) -> float:
        chosen = particles_enu_m[:, np.linspace(0, particles_enu_m.shape[1] - 1, number).astype(np.intp)]
        started_s = time.perf_counter()
        brute_force_weights(PAPER_CAMERA, chosen, pose, mask)
        return time.perf_counter() - started_s


def _mask(pose: CameraPose) -> NDArray[np.uint8]:
    mask: NDArray[np.uint8] = np.zeros((PAPER_CAMERA.height, PAPER_CAMERA.width), dtype=np.uint8)
    paper_scene().target.draw(mask, PAPER_CAMERA, pose)
    return mask


def _result(n_particles: int, ours: _Calibrated, bootstrap: _Bootstrap, brute: _BruteForce) -> Bench:
    times_s, resampled = np.array(ours.times_s), np.array(ours.resampled)
    median_s = float(np.median(times_s))
    bootstrap_s, brute_s = float(np.median(bootstrap.times_s)), float(np.median(brute.times_s))
    return Bench(
        n_particles=n_particles,
        calibrated=Timing(_ms(median_s), 1.0, times_s.size),
        calibrated_with_resampling_ms=_median_ms(times_s[resampled]),
        calibrated_without_resampling_ms=_median_ms(times_s[~resampled]),
        resampled_steps=int(resampled.sum()),
        bootstrap=Timing(_ms(bootstrap_s), round(bootstrap_s / median_s, 3), len(bootstrap.times_s)),
        brute_force_update=BruteTiming(
            _ms(brute_s), round(brute_s / median_s, 3), len(brute.times_s), brute.particles, brute.positive_pixels
        ),
    )


def _median_ms(times_s: FloatArray) -> float | None:
    return _ms(float(np.median(times_s))) if times_s.size else None


def _ms(time_s: float) -> float:
    return round(time_s * 1e3, 4)


def _table(result: Bench) -> str:
    brute = result.brute_force_update
    lines = [
        f"one step of one target, {result.n_particles} particles, medians over a perpendicular flight",
        f"{'':44}{'ms':>10}{'ratio':>9}{'steps':>7}",
        _line("calibrated", result.calibrated.median_ms, 1.0, result.calibrated.steps),
    ]
    for name, median_ms, steps in (
        ("with resampling", result.calibrated_with_resampling_ms, result.resampled_steps),
        ("without", result.calibrated_without_resampling_ms, result.calibrated.steps - result.resampled_steps),
    ):
        if median_ms is not None:
            lines.append(_line(f"  {name}", median_ms, median_ms / result.calibrated.median_ms, steps))
    lines.append(
        _line("bootstrap, the paper's", result.bootstrap.median_ms, result.bootstrap.ratio, result.bootstrap.steps)
    )
    lines.append(_line("its update alone, by brute force", brute.median_ms, brute.ratio, brute.steps))
    lines.append(
        f"brute force: each particle against all {brute.positive_pixels} positive pixels, no box, no chamfer map"
    )
    if brute.particles < result.n_particles:
        lines.append(
            f"(timed on {brute.particles} particles and scaled up: all would take over {_BRUTE_BUDGET_S:.0f} s)"
        )
    return "\n".join(lines)


def _line(name: str, median_ms: float, ratio: float, steps: int) -> str:
    return f"{name:44}{median_ms:10.2f}{ratio:9.2f}{steps:7d}"
