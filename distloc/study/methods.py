"""The methods under study behind one interface: a pose and a mask in, a position or the reason for none out."""

from dataclasses import dataclass
from typing import Literal, Protocol

import cv2
import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.triangulate import triangulate_dlt, triangulate_ransac
from distloc.localizer import Localizer, LocalizerConfig
from distloc.sights.detections import checked_mask, detections_from_mask
from distloc.study.scenes import Noise
from distloc.types import CameraPose, FloatArray, MaskArray, PoseErrors, RejectReason

_LEAST_POSITION_M = 0.1
BIAS_BLIND_RAD = 1e-6  # a bias so small that the filter takes the attitude to have none


class Method(Protocol):
    """One method on one flight."""

    def step(self, pose: CameraPose, mask: MaskArray) -> FloatArray | RejectReason | None:
        """The target's position (3,) in ENU after this frame; None where nothing has been seen yet."""
        ...

    @property
    def particles_enu_m(self) -> FloatArray | None:
        """The particles (3, N) of a method that has them."""
        ...


def box_centre_px(mask: MaskArray, camera: Camera) -> FloatArray | None:
    """The centre (2,) of the bounding box of all positive pixels; None for an empty mask."""
    pixels, scale = checked_mask(mask, camera)
    left, top, width, height = cv2.boundingRect(pixels)
    if width == 0:
        return None
    corner = np.array([left + (width - 1) / 2.0, top + (height - 1) / 2.0])
    return np.asarray(corner * scale + (scale - 1) / 2.0)


class Mvt:
    """The paper's multi-view triangulation: the centre of everything positive, DLT over all frames so far."""

    particles_enu_m: FloatArray | None = None

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._poses: list[CameraPose] = []
        self._pixels: list[FloatArray] = []

    def step(self, pose: CameraPose, mask: MaskArray) -> FloatArray | RejectReason | None:
        """Take a frame and triangulate."""
        centre = box_centre_px(mask, self._camera)
        if centre is not None:
            self._poses.append(pose)
            self._pixels.append(centre)
        if not self._poses:
            return None
        return triangulate_dlt(self._camera, self._poses, np.stack(self._pixels, axis=1))


class Rmvt:
    """The paper's robust triangulation; `is_literal`: the centre of everything positive and a gate of 2 px, as there.

    Else each segment is an observation of its own, so that clutter does not move a centre, and the gate follows from
    the noise.
    """

    particles_enu_m: FloatArray | None = None

    def __init__(self, camera: Camera, rng: np.random.Generator, is_literal: bool = False) -> None:
        self._camera, self._rng, self._is_literal = camera, rng, is_literal
        self._poses: list[CameraPose] = []
        self._pixels: list[FloatArray] = []

    def step(self, pose: CameraPose, mask: MaskArray) -> FloatArray | RejectReason | None:
        """Take a frame and triangulate."""
        for centre in self._centres(mask):
            self._poses.append(pose)
            self._pixels.append(centre)
        if not self._poses:
            return None
        gate_px = 2.0 if self._is_literal else None
        pixels = np.stack(self._pixels, axis=1)
        return triangulate_ransac(self._camera, self._poses, pixels, rng=self._rng, gate_px=gate_px)[0]

    def _centres(self, mask: MaskArray) -> list[FloatArray]:
        if not self._is_literal:
            return [segment.centre_px for segment in detections_from_mask(mask, self._camera)]
        centre = box_centre_px(mask, self._camera)
        return [] if centre is None else [centre]


class LocalizerMethod:
    """The localizer that flies; of several targets, the one with the most sightings."""

    def __init__(self, camera: Camera, rng: np.random.Generator, config: LocalizerConfig) -> None:
        self._localizer = Localizer(camera, config, rng=rng)
        self._target_id: int | None = None

    @property
    def particles_enu_m(self) -> FloatArray | None:
        """The particles (3, N) of the target that `step` spoke of."""
        return None if self._target_id is None else self._localizer.particles_enu_m(self._target_id)

    def step(self, pose: CameraPose, mask: MaskArray) -> FloatArray | RejectReason | None:
        """Take a frame and step the filter."""
        targets = self._localizer.step(pose, mask)
        if not targets:
            self._target_id = None
            return None
        best = max(targets, key=lambda target: (target.observations, -target.id))
        self._target_id = best.id
        return best.position_enu_m


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """How a method is made for a flight; `name` is the table's. It can be sent to another process."""

    name: str
    kind: Literal["MVT", "RMVT", "RMVT-literal", "localizer"]
    config: LocalizerConfig | None = None

    def make(self, camera: Camera, rng: np.random.Generator) -> Method:
        """The method at the start of a flight."""
        match self.kind:
            case "MVT":
                return Mvt(camera)
            case "RMVT" | "RMVT-literal":
                return Rmvt(camera, rng, self.kind == "RMVT-literal")
            case _:
                return LocalizerMethod(camera, rng, self.config or LocalizerConfig())


def paper_methods() -> tuple[MethodSpec, ...]:
    """The paper's three with its settings, and its robust triangulation with a gate that follows from the noise."""
    names: tuple[Literal["MVT", "RMVT-literal", "RMVT"], ...] = ("MVT", "RMVT-literal", "RMVT")
    return (*(MethodSpec(name, name) for name in names), bootstrap_spec("PF"))


def bootstrap_spec(name: str, n_particles: int = 100_000, particle_sigma_m: float = 5.0) -> MethodSpec:
    """The paper's filter, stepped at every frame that it is given."""
    config = LocalizerConfig(
        filter="bootstrap", n_particles=n_particles, particle_sigma_m=particle_sigma_m, step_distance_m=0.0
    )
    return MethodSpec(name, "localizer", config)


def calibrated_spec(name: str = "RBPF", errors: PoseErrors | None = None) -> MethodSpec:
    """The filter that flies, stepped at every frame; told of the poses' errors, where a pose does not bring its own."""
    return MethodSpec(
        name, "localizer", told_config(errors) if errors else LocalizerConfig(step_distance_m=0.0, aim="centre")
    )


def told_config(errors: PoseErrors, n_particles: int = 100_000) -> LocalizerConfig:
    """The filter that flies, stepped at every frame, with the sizes of the poses' errors, at a box's centre."""
    return LocalizerConfig(
        aim="centre",
        n_particles=n_particles,
        step_distance_m=0.0,
        position_sigma_m=errors.position_m,
        attitude_white_sigma_rad=errors.attitude_white_rad,
        heading_bias_sigma_rad=errors.heading_bias_rad,
        tilt_bias_sigma_rad=errors.tilt_bias_rad,
        bias_time_constant_s=errors.bias_time_constant_s,
        bias_turn_rad=errors.bias_turn_rad,
    )


def all_methods(noise: Noise) -> tuple[MethodSpec, ...]:
    """The paper's, and the filter that flies."""
    return (*paper_methods(), told_spec("RBPF", noise))


def told_spec(name: str, noise: Noise, n_particles: int = 100_000) -> MethodSpec:
    """The filter that flies, told how large this noise is: no bias, the uniform laws' sigmas."""
    errors = PoseErrors(
        heading_bias_rad=BIAS_BLIND_RAD,
        tilt_bias_rad=BIAS_BLIND_RAD,
        attitude_white_rad=noise.rotation_rad / float(np.sqrt(3.0)),
        position_m=max(noise.translation_m / float(np.sqrt(3.0)), _LEAST_POSITION_M),
        bias_time_constant_s=600.0,
    )
    return MethodSpec(name, "localizer", told_config(errors, n_particles))
