"""What is learnt of many targets at once is what is learnt of each alone."""

import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.tracks.looks.jitter import Jitter
from distloc.tracks.looks.plume import Middles
from distloc.tracks.looks.segment_sizes import SegmentSizes

CAMERA = Camera(1000, 1000, 1000.0, 500.0, 500.0, 500.0)
ROWS, STEPS = 4, 40
FIRST = np.array([0])


def test_the_expected_size_is_a_high_quantile_of_the_latest() -> None:
    sizes, rng = SegmentSizes(ROWS), np.random.default_rng(0)
    seen: list[list[np.ndarray]] = [[] for _ in range(ROWS)]
    for _ in range(STEPS):
        rows = np.flatnonzero(rng.random(ROWS) < [0.0, 0.1, 0.5, 1.0])
        sizes_px = rng.uniform(10.0, 100.0, (rows.size, 2))
        sizes.add(rows, sizes_px)
        for row, size_px in zip(rows, sizes_px, strict=True):
            seen[row].append(size_px)
    assert np.isnan(sizes.expected_px[0]).all() and np.isinf(sizes.most_px[0]).all()
    extents = sizes.extents(np.arange(ROWS), CAMERA, np.full(ROWS, 2000.0), np.full(ROWS, 50.0))
    assert extents[0] is None
    for row in range(1, ROWS):
        latest = np.array(seen[row][-15:])
        assert sizes.all_px(row) == pytest.approx(latest)
        assert sizes.expected_px[row] == pytest.approx(np.quantile(latest, 0.8, axis=0))
        extent, median = extents[row], np.median(latest, axis=0)
        assert extent is not None
        assert (extent.width_m, extent.height_m) == pytest.approx((2.0 * median[0], 4.0 * median[1]))
        width_sigma_m = np.hypot(0.05 * median[0], 2.0 * latest[:, 0].std())
        assert extent.width_sigma_m == pytest.approx(width_sigma_m)
        again = SegmentSizes(1)
        again.restore(0, latest)
        assert again.expected_px[0] == pytest.approx(sizes.expected_px[row])
        assert again.most_px[0] == pytest.approx(sizes.most_px[row])
    sizes.clear(slice(1, 3))
    assert np.isnan(sizes.expected_px[1:3]).all() and sizes.all_px(1).size == 0 and sizes.all_px(3).size == 30


def test_roots_that_jump_about_are_told_and_an_axis_that_is_cut_goes_by_the_other() -> None:
    jitter, rng = Jitter(3), np.random.default_rng(1)
    is_cut = np.array([[False, False], [True, False], [True, True]])
    rows, roots_rad = np.arange(3), np.full(3, 0.01)
    jitter.add(rows, np.zeros((3, 2)), roots_rad, is_cut)
    assert np.sqrt(jitter.variance) == pytest.approx(0.001)  # a tenth of its width, to begin with
    for _ in range(400):
        jitter.add(rows, rng.normal(0.0, [0.004, 0.002], (3, 2)), roots_rad, is_cut)
    assert np.sqrt(jitter.variance[0]) == pytest.approx([0.004, 0.002], rel=0.5)
    assert np.sqrt(jitter.variance[1]) == pytest.approx(0.002, rel=0.5)
    assert np.sqrt(jitter.variance[2]) == pytest.approx(0.001)  # of it nothing is known


def test_one_row_is_alone_what_it_is_among_others() -> None:
    rng = np.random.default_rng(2)
    many, alone = (Jitter(ROWS), Middles(ROWS)), [(Jitter(1), Middles(1)) for _ in range(ROWS)]
    for _ in range(STEPS):
        rows = np.flatnonzero(rng.random(ROWS) < 0.6)
        off, root_rad = rng.normal(0.0, 0.01, (rows.size, 2)), rng.uniform(0.001, 0.02, rows.size)
        is_cut, axes = rng.random((rows.size, 2)) < 0.2, rng.normal(size=(rows.size, 3, 3))
        many[0].add(rows, off, root_rad, is_cut)
        many[1].add(rows, off, axes)
        for at, row in enumerate(rows):
            one = slice(at, at + 1)
            alone[row][0].add(FIRST, off[one], root_rad[one], is_cut[one])
            alone[row][1].add(FIRST, off[one], axes[one])
    for row, (jitter, middles) in enumerate(alone):
        assert many[0].variance[row] == pytest.approx(jitter.variance[0], rel=1e-12)
        assert many[1].off[row] == pytest.approx(middles.off[0], rel=1e-12)
