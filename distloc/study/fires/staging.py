"""A scene before it is flown: fires, what else is in the pictures, path, masks and reported poses, by a seed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.simulation.flights import Flight, flight_past
from distloc.simulation.mask_noise import MaskNoise, MaskNoiser
from distloc.simulation.paths import arc
from distloc.simulation.pose_noise import CorrelatedPoseErrors
from distloc.study.coverage.cases import ERROR_CLASSES
from distloc.study.fires.beside import Bird, Spot, dirt, flocks
from distloc.study.fires.border import Border
from distloc.study.fires.cases import CAMERA, SceneCase
from distloc.study.fires.clutter import SEGMENTER_NOISE, Ball, birds, clouds, dust
from distloc.study.fires.smoke import Smoke, Source
from distloc.types import BoolArray, CameraPose, FloatArray

STEP_S = 1.0
_ERROR_CLASS = "scenery"  # its sizes; no corners are followed
_HEIGHT_M = 100.0
_WOBBLE_RAD = 0.02
_CIRCLE_M = 800.0
_APART_M = 120.0
_BEHIND_M = 700.0  # of two fires in line
_TRIES = 1000
_EAST, _NORTH = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class SceneRun:
    """One flight of a case, seeded by `seed` alone; `length_share` cuts it short."""

    case: SceneCase
    seed: int
    n_particles: int
    length_share: float = 1.0


@dataclass(frozen=True, slots=True)
class SceneFrame:
    """The mask (H, W), the reported pose and the true one, and which fires' smoke is in the picture (K,)."""

    mask: NDArray[np.uint8]
    pose: CameraPose
    true_pose: CameraPose
    is_in_view: BoolArray


@dataclass(frozen=True, slots=True)
class SceneStage:
    """The frames in the order of time, the fires' smoke (K) and the filter's generator."""

    frames: Iterator[SceneFrame]
    fires: list[Smoke]
    filter_rng: np.random.Generator


def staged(run: SceneRun) -> SceneStage:
    """A flight; nothing is drawn before its frames are asked for."""
    case = run.case
    fire_rng, clutter_rng, mask_rng, pose_rng, filter_rng, beside_rng = (
        np.random.Generator(np.random.SFC64(one)) for one in np.random.SeedSequence([79, run.seed]).spawn(6)
    )
    range_m = float(np.exp(fire_rng.uniform(*np.log(case.range_m))))
    flight = _flight(case, run.seed, range_m)
    middle_enu_m = range_m * _NORTH
    fires = _fires(case, middle_enu_m, float(flight.stamps_s[-1]), fire_rng)
    others: list[Ball | Smoke | Bird | Spot] = [*clouds(case.far_things, flight.pose_at(0.0), clutter_rng)]
    if case.has_clutter:
        others += [*birds(flight, clutter_rng), *dust(flight, middle_enu_m, range_m, clutter_rng)]
    pose_at: Callable[[float], CameraPose] = flight.pose_at
    end_s = float(flight.stamps_s[-1])
    if case.has_birds:
        others += flocks(flight, beside_rng)
    if case.has_dirt:
        others += dirt(CAMERA, flight.pose_at(0.7 * end_s), middle_enu_m, beside_rng)
    if case.border_share:
        until_s = case.border_share * end_s + 0.5 * STEP_S
        pose_at = Border.drawn(fires[0].source, until_s, run.seed, beside_rng).aside(flight.pose_at, CAMERA)
    errors = CorrelatedPoseErrors(ERROR_CLASSES[_ERROR_CLASS], pose_rng)
    noiser = MaskNoiser(SEGMENTER_NOISE if case.has_clutter else MaskNoise(), CAMERA, mask_rng)
    stamps_s = flight.stamps_s[: max(2, round(run.length_share * flight.stamps_s.size))]

    def frames() -> Iterator[SceneFrame]:
        for stamp_s in map(float, stamps_s):
            true_pose = pose_at(stamp_s)
            masks = np.zeros((len(fires), CAMERA.height, CAMERA.width), np.uint8)
            for fire, own in zip(fires, masks, strict=True):
                fire.draw(own, CAMERA, true_pose)
            mask = noiser.apply(*masks)
            for other in others:
                other.draw(mask, CAMERA, true_pose)
            is_in_view: BoolArray = np.array([own.any() for own in masks])
            yield SceneFrame(mask, errors.reported(pose_at, stamp_s), true_pose, is_in_view)

    return SceneStage(frames(), fires, filter_rng)


def _flight(case: SceneCase, seed: int, range_m: float) -> Flight:
    """With a frame a second; the camera looks level or down at the smoke's foot, and to the right in circuits."""
    way = case.ways[seed % len(case.ways)]
    duration_s = case.duration_s or case.length_share * range_m / case.speed_mps
    stamps_s = np.arange(round(duration_s / STEP_S) + 1, dtype=np.float64) * STEP_S
    if way == "circuits":
        centre = _HEIGHT_M * np.array([0.0, 0.0, 1.0])
        path = arc(centre, _CIRCLE_M, np.pi, case.speed_mps, False, _WOBBLE_RAD, seed)
        return Flight(path, stamps_s, (np.pi / 2.0, 0.0, 0.0))
    aim = np.array([0.0, range_m, min(_HEIGHT_M, 0.4 * case.look.height_m)])
    length_m = duration_s * case.speed_mps
    past = flight_past(way, aim, range_m, length_m, case.speed_mps, _HEIGHT_M, _WOBBLE_RAD, seed, case.speed_mps)
    return Flight(past.path, stamps_s, past.mount_rad)


def _fires(case: SceneCase, middle_enu_m: FloatArray, end_s: float, rng: np.random.Generator) -> list[Smoke]:
    """On the ground; what moves is at its place half-way through the flight."""
    side, azimuth_rad = float(rng.choice([-1.0, 1.0])), float(rng.uniform(0.0, 2.0 * np.pi))
    any_way = np.array([np.sin(azimuth_rad), np.cos(azimuth_rad), 0.0])
    towards = {"calm": np.zeros(3), "toward": -_NORTH, "across": side * _EAST, "away": _NORTH, "any": any_way}
    moves = {"across": side * _EAST, "along": side * _NORTH, "any": any_way[[1, 0, 2]]}
    wind, velocity = case.wind_mps * towards[case.wind], case.source_mps * moves[case.motion]
    return [
        Smoke(
            Source(
                middle_enu_m + offset - 0.5 * end_s * velocity,
                case.look,
                wind,
                velocity,
                (case.lit_s, np.inf),
                case.hidden_m,
            ),
            rng,
        )
        for offset in _offsets(case, rng)
    ]


def _offsets(case: SceneCase, rng: np.random.Generator) -> list[FloatArray]:
    """Where the fires stand (3,) each about their middle: at least `_APART_M` from each other."""
    if case.layout == "in_line":
        return [np.zeros(3), _BEHIND_M * _NORTH + rng.uniform(-150.0, 150.0) * _EAST]
    if case.fires == 1:
        return [np.zeros(3)]
    found: list[FloatArray] = []
    for _ in range(_TRIES):
        azimuth, away_m = rng.uniform(0.0, 2.0 * np.pi), 0.5 * case.within_m * np.sqrt(rng.uniform())
        place = away_m * np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
        if all(np.linalg.norm(place - other) >= _APART_M for other in found):
            found.append(place)
        if len(found) == case.fires:
            return found
    raise ValueError(f"{case.fires} fires {_APART_M:.0f} m apart must fit within_m, got {case.within_m}")
