"""The paper's update as it is written, each particle against all positive pixels, beside our whole step."""

from collections.abc import Callable

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.study.scenes import PAPER_CAMERA
from distloc.types import CameraPose, FloatArray
from service.commands.bench.filters.filter_step import PAPER_COUNT, Bootstrap, Calibrated
from service.commands.bench.scene import Seen, fly
from service.commands.bench.timing import Figure, figure, median_ms, timed_s

BUDGET_S = 20.0  # a round that takes longer is timed on fewer particles and scaled up
_ROUNDS = 3  # spread over the flight: each takes seconds
_TRIAL = 500  # particles that tell how long all will take
_PAIRS = 1 << 18  # of particle and pixel at a time: 2 MB, whatever the mask


class LiteralUpdate(msgspec.Struct, frozen=True):
    """The weights alone, for all particles; `timed_particles` of them were timed. Ratios are to the calibrated step."""

    n_particles: int
    calibrated: Figure
    literal: Figure
    timed_particles: int
    positive_pixels: int


def measure_literal(
    n_particles: int = PAPER_COUNT,
    number: int | None = None,
    budget_s: float = BUDGET_S,
    on_step: Callable[[], None] = lambda: None,
) -> LiteralUpdate:
    """Fly ours and the paper's; at some frames of the flight its particles are weighed literally as well."""
    ours, bootstrap = Calibrated(n_particles), Bootstrap(n_particles)
    literal = _Literal(bootstrap, n_particles, budget_s)
    rounds = {round(index) for index in np.linspace(1, 100 if number is None else number - 1, _ROUNDS)}
    index = 0

    def stepped(seen: Seen) -> None:
        nonlocal index
        index += 1
        if index in rounds:
            literal.weigh(seen)
        on_step()

    times_s = fly({"ours": ours, "bootstrap": bootstrap}, number, stepped)
    unit_ms = median_ms(times_s["ours"])
    return LiteralUpdate(
        n_particles=n_particles,
        calibrated=figure(times_s["ours"], unit_ms),
        literal=figure(literal.times_s, unit_ms),
        timed_particles=literal.particles,
        positive_pixels=literal.positive_pixels,
    )


def literal_weights(
    camera: Camera, particles_enu_m: FloatArray, pose: CameraPose, mask: NDArray[np.uint8]
) -> FloatArray:
    """exp(-min d^2) (N,) over all positive pixels of a full-size mask."""
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


class _Literal:
    def __init__(self, bootstrap: Bootstrap, n_particles: int, budget_s: float) -> None:
        self.particles = n_particles
        self.positive_pixels = 0
        self.times_s: list[float] = []
        self._bootstrap, self._n_particles, self._budget_s = bootstrap, n_particles, budget_s

    def weigh(self, seen: Seen) -> None:
        self.positive_pixels = cv2.countNonZero(seen.mask)
        if not self.times_s:
            trial = min(_TRIAL, self._n_particles)
            share = self._budget_s / max(self._timed_s(seen, trial), 1e-9)
            self.particles = max(trial, min(self._n_particles, int(trial * share)))
        self.times_s.append(self._timed_s(seen, self.particles) * self._n_particles / self.particles)

    def _timed_s(self, seen: Seen, number: int) -> float:
        cloud = self._bootstrap.filter.particles_enu_m
        chosen = cloud[:, np.linspace(0, cloud.shape[1] - 1, number).astype(np.intp)]
        return timed_s(lambda: literal_weights(PAPER_CAMERA, chosen, seen.pose, seen.mask))
