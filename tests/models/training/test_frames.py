"""Where smoke is laid over a background: before the sky, across the horizon, and on the land alone."""

import numpy as np

from frames import CROP_H, CROP_W, EITHER, NOT_SMOKE, SMOKE, Background, draw_frame
from plumes import draw_plume

HORIZON = 90


def land() -> Background:
    """Dark land under a bright sky, as large as a crop; the sky's label is EITHER, which tells it in what is drawn."""
    image, label = np.full((CROP_H, CROP_W, 3), 60, np.uint8), np.full((CROP_H, CROP_W), NOT_SMOKE, np.uint8)
    image[:HORIZON], label[:HORIZON] = 200, EITHER
    rank = np.zeros((CROP_H, CROP_W), np.uint8)
    return Background(image, label, rank, (float(HORIZON), float(HORIZON)), np.full(3, 210.0, np.float32))


def test_a_good_part_of_the_smoke_has_only_land_behind_it() -> None:
    plumes = [draw_plume(np.random.default_rng(seed)) for seed in range(4)]
    on_land, across = 0, 0
    for seed in range(60):
        _, label = draw_frame(np.random.default_rng(seed), land(), plumes)
        rows = np.flatnonzero((label == SMOKE).any(axis=1))
        sky = (label[:, 0] == EITHER).sum()
        if not rows.size or not 10 < sky < CROP_H - 10:
            continue
        on_land += bool(rows.min() > sky)
        across += bool(rows.min() < sky)
    assert 0.28 < on_land / (on_land + across) < 0.55
