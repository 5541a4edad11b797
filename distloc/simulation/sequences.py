"""A simulated sequence: what a localiser is given frame by frame, and the truth beside it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.flights import Flown
from distloc.simulation.mask_noise import MaskNoise, MaskNoiser
from distloc.simulation.pose_noise import PoseNoise
from distloc.simulation.targets import Target
from distloc.types import CameraPose


@dataclass(frozen=True, slots=True)
class Sample:
    """One frame: the pose and the mask (H, W) as reported, and the true pose. The mask is the caller's to keep."""

    pose: CameraPose
    mask: NDArray[np.uint8]
    true_pose: CameraPose


def simulate_sequence(
    camera: Camera,
    flight: Flown,
    targets: Sequence[Target],
    mask_noise: MaskNoise,
    pose_noise: PoseNoise,
    rng: np.random.Generator,
) -> Iterator[Sample]:
    """The flight's frames in the order of time; `rng` is for the masks."""
    noiser = MaskNoiser(mask_noise, camera, rng)
    for stamp_s in flight.stamps_s:
        true_pose = flight.pose_at(float(stamp_s))
        masks: NDArray[np.uint8] = np.zeros((max(len(targets), 1), camera.height, camera.width), dtype=np.uint8)
        for target, mask in zip(targets, masks, strict=False):
            target.draw(mask, camera, true_pose)
        yield Sample(pose_noise.reported(flight.pose_at, float(stamp_s)), noiser.apply(*masks), true_pose)
