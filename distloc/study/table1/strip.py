"""Simulated frames along the flight, without noise and with all of it: the paper's strip of pictures."""

import numpy as np

from distloc.simulation.sequences import simulate_sequence
from distloc.study.scenes import NOISES, Scene
from distloc.study.table1.curves import translation_m
from distloc.types import MaskArray

_FRAMES = 8


def strip_frames(scene: Scene, seed: int) -> tuple[dict[str, list[MaskArray]], list[str]]:
    """Masks (H, W) of evenly spaced frames by row, and the columns' labels."""
    translation = translation_m(scene)
    chosen = np.round(np.linspace(0, translation.size - 1, _FRAMES)).astype(int)
    rows: dict[str, list[MaskArray]] = {}
    for title, name in (("noiseless", "none"), ("all noises", "pfn")):
        rng = np.random.default_rng([seed, 0])
        noise = NOISES[name]
        frames = simulate_sequence(scene.camera, scene.flight, [scene.target], noise.mask, noise.pose_noise(rng), rng)
        rows[title] = [sample.mask for index, sample in enumerate(frames) if index in chosen]
    return rows, [f"{translation[index]:.0f} m" for index in chosen]
