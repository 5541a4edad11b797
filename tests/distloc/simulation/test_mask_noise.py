from dataclasses import dataclass, field
from math import comb

import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.simulation.mask_noise import MaskNoise, MaskNoiser, Rectangle
from distloc.types import FloatArray

CAMERA = Camera(64, 36, 40.0, 40.0, 31.5, 17.5)
SIDES_PX = (2, 6)
FRAMES = 25_000


def target_mask(left: int = 20, top: int = 10, width: int = 20, height: int = 12) -> NDArray[np.uint8]:
    mask = np.zeros((36, 64), dtype=np.uint8)
    mask[top : top + height, left : left + width] = 255
    return mask


NO_TARGET = target_mask(width=0)
TARGET = target_mask()


def noiser(noise: MaskNoise, seed: int = 0) -> MaskNoiser:
    return MaskNoiser(noise, CAMERA, np.random.default_rng(seed))


def positives(rate: float, dismissal: float, most: int = 3) -> MaskNoise:
    return MaskNoise(rate, dismissal, most, false_positive_side_px=SIDES_PX)


def union(rectangles: list[Rectangle]) -> NDArray[np.uint8]:
    mask = np.zeros((36, 64), dtype=np.uint8)
    for one in rectangles:
        mask[one.top : one.bottom, one.left : one.right] = 255
    return mask


@dataclass
class Census:
    """How long each thing lived, in the order of appearance; how often one could have appeared, and did."""

    things: list[object] = field(default_factory=list)
    lives: list[int] = field(default_factory=list)
    chances: int = 0
    counts: list[int] = field(default_factory=list)
    present: list[int] = field(default_factory=list)

    def add(self, now: list[object], most: int) -> None:
        kept = [i for i in self.present if any(self.things[i] is one for one in now)]
        born = [one for one in now if not any(one is self.things[i] for i in kept)]
        assert len(born) <= 1
        self.chances += len(kept) < most
        self.present = kept + [len(self.things) + i for i in range(len(born))]
        self.things += born
        self.lives += [0] * len(born)
        for i in self.present:
            self.lives[i] += 1
        self.counts.append(len(now))


def census_of_positives(noise: MaskNoise, seed: int = 0) -> Census:
    census, one = Census(), noiser(noise, seed)
    for frame in range(FRAMES):
        mask = one.apply(NO_TARGET)
        census.add(list(one.false_positives), noise.max_false_positives)
        if frame < 300:
            assert np.array_equal(mask, union(one.false_positives))
    return census


def stationary(rate: float, dismissal: float, most: int) -> FloatArray:
    chain = np.zeros((most + 1, most + 1))
    for before in range(most + 1):
        for left in range(before + 1):
            share = comb(before, left) * (1.0 - dismissal) ** left * dismissal ** (before - left)
            if left < most:
                chain[before, left + 1] += share * rate
                chain[before, left] += share * (1.0 - rate)
            else:
                chain[before, left] += share
    return np.linalg.matrix_power(chain, 2000)[0]


@pytest.mark.parametrize(("rate", "dismissal", "most"), [(0.1, 0.2, 3), (0.5, 0.15, 3), (0.3, 0.4, 1)])
def test_false_positives_appear_and_stay_as_the_rates_say(rate: float, dismissal: float, most: int) -> None:
    census = census_of_positives(positives(rate, dismissal, most))
    lives, counts = np.array(census.lives), np.array(census.counts)
    n = lives.size
    assert n > 2000 and counts.max() == most
    assert len(census.things) / census.chances == pytest.approx(rate, abs=4.0 * np.sqrt(rate / census.chances))
    assert lives.min() == 1
    assert lives.mean() == pytest.approx(1.0 / dismissal, rel=0.06)
    assert lives.var() == pytest.approx((1.0 - dismissal) / dismissal**2, rel=0.15)
    for frames in (1, 2, 3):
        share = dismissal * (1.0 - dismissal) ** (frames - 1)
        assert np.mean(lives == frames) == pytest.approx(share, abs=4.0 * np.sqrt(share / n))
    expected = stationary(rate, dismissal, most)
    assert np.bincount(counts, minlength=most + 1) / FRAMES == pytest.approx(expected, abs=0.025)
    assert counts.mean() == pytest.approx(expected @ np.arange(most + 1), rel=0.06)


def test_rectangles_are_uniform_and_inside_the_image() -> None:
    census = census_of_positives(positives(0.5, 0.5), seed=1)
    rectangles = [one for one in census.things if isinstance(one, Rectangle)]
    left, top, right, bottom = np.array([(one.left, one.top, one.right, one.bottom) for one in rectangles]).T
    assert left.size > 5000
    assert (left.min(), top.min(), right.max(), bottom.max()) == (0, 0, 64, 36)
    for side in (right - left, bottom - top):
        assert np.bincount(side) / side.size == pytest.approx([0.0, 0.0, *[0.2] * 5], abs=0.02)
    assert abs(np.corrcoef(right - left, bottom - top)[0, 1]) < 0.04
    for place in (left / (64 - right + left), top / (36 - bottom + top)):
        assert place.mean() == pytest.approx(0.5, abs=0.02)
        assert place.std() == pytest.approx(np.sqrt(1.0 / 12.0), abs=0.02)


def test_false_negatives_are_independent_from_frame_to_frame() -> None:
    one = noiser(MaskNoise(false_negative_rate=0.1))
    empty = np.array([not one.apply(TARGET).any() for _ in range(FRAMES)], dtype=np.float64)
    assert empty.mean() == pytest.approx(0.1, abs=0.007)
    assert np.abs([np.corrcoef(empty[:-lag], empty[lag:])[0, 1] for lag in (1, 2, 5)]).max() < 0.025
    assert empty[:-1] @ empty[1:] / FRAMES == pytest.approx(0.01, abs=0.003)


def test_a_false_negative_leaves_the_false_positives() -> None:
    noise = MaskNoise(0.3, 0.2, 3, false_negative_rate=0.5, false_positive_side_px=SIDES_PX)
    one, emptied, both = noiser(noise), 0, 0
    for _ in range(2000):
        mask = one.apply(TARGET)
        rectangles = union(one.false_positives)
        seen = rectangles if one.is_false_negative else np.maximum(rectangles, TARGET)
        assert np.array_equal(mask, seen)
        emptied += one.is_false_negative
        both += one.is_false_negative and bool(one.false_positives)
    assert 900 < emptied < 1100 and 500 < both < emptied


def test_partial_negatives_appear_stay_and_keep_their_place_on_the_target() -> None:
    one, census = noiser(MaskNoise(partial_rate=0.1, partial_dismissal=0.2)), Census()
    sections: list[NDArray[np.bool_]] = []
    shares: list[float] = []
    for frame in range(FRAMES):
        left, top = (7 * frame) % 44, (5 * frame) % 24
        mask = one.apply(target_mask(left, top))
        erased = mask[top : top + 12, left : left + 20] == 0
        assert np.count_nonzero(mask) == 240 - np.count_nonzero(erased)
        assert erased.any() == (one.partial is not None)
        census.add([] if one.partial is None else [one.partial], 1)
        if len(census.things) > len(sections):
            sections.append(erased)
            rows, columns = np.flatnonzero(erased.any(axis=1)), np.flatnonzero(erased.any(axis=0))
            assert np.count_nonzero(erased) == rows.size * columns.size  # a rectangle
            shares.append(float(erased.mean()))
        elif one.partial is not None:
            assert np.array_equal(erased, sections[-1])
    lives = np.array(census.lives)
    assert len(census.things) / census.chances == pytest.approx(0.1, abs=0.01)
    assert lives.mean() == pytest.approx(5.0, rel=0.08)
    assert lives.var() == pytest.approx(20.0, rel=0.25)
    assert np.mean(lives == 1) == pytest.approx(0.2, abs=0.04)
    assert 0.0 < min(shares) < 0.1 and max(shares) > 0.8 and np.mean(np.array(shares) == 1.0) < 0.01
    # a side of w about a random point of [0, 1] covers w - w^2 / 4 of it (w <= 1; 1 - (2 - w)^2 / 4 beyond): with w
    # uniform from 0.25 to 1.25 that is 0.5887 on average, two sides 0.3465
    assert np.mean(shares) == pytest.approx(0.3465, abs=0.02)
    reached = np.mean(sections, axis=0)
    assert 0.1 < reached.min() < 0.25 and 0.45 < reached.max() < 0.7  # corners least, the middle most
    moved = np.mean([_box_is_smaller(erased) for erased in sections])
    assert 0.05 < moved < 0.2  # it can take a side away


def _box_is_smaller(erased: NDArray[np.bool_]) -> bool:
    left = ~erased
    return not (left.any(axis=1).all() and left.any(axis=0).all())


def test_a_partial_negative_leaves_false_positives_alone() -> None:
    one = noiser(MaskNoise(1.0, 0.1, 3, partial_rate=1.0, partial_dismissal=0.5, false_positive_side_px=SIDES_PX))
    for _ in range(200):
        mask = one.apply(TARGET)
        assert (mask[union(one.false_positives) > 0] == 255).all()
        assert np.count_nonzero(mask & TARGET) < 240 or np.count_nonzero(union(one.false_positives) & TARGET) > 0


NOISY = MaskNoise(0.3, 0.2, 3, 0.1, 0.3, 0.2, SIDES_PX)


def test_the_targets_mask_stays_as_it_is() -> None:
    one, given = noiser(NOISY), target_mask()
    for _ in range(300):
        assert not np.shares_memory(one.apply(given), given)
        assert np.array_equal(given, TARGET)
    clean = noiser(MaskNoise()).apply(given)
    assert np.array_equal(clean, TARGET) and not np.shares_memory(clean, given)


def test_the_same_seed_gives_the_same_masks() -> None:
    first, same, other = (noiser(NOISY, seed) for seed in (4, 4, 5))
    masks = [[one.apply(TARGET) for _ in range(200)] for one in (first, same, other)]
    assert np.array_equal(masks[0], masks[1])
    assert not np.array_equal(masks[0], masks[2])


def test_rates_of_zero_do_nothing_and_rates_of_one_do_it_always() -> None:
    one = noiser(MaskNoise(0.0, 1.0, 3, 0.0, 0.0, 1.0))
    assert all(np.array_equal(one.apply(TARGET), TARGET) for _ in range(500))
    filling = noiser(positives(1.0, 0.0))
    counts = []
    for _ in range(6):
        filling.apply(TARGET)
        counts.append(len(filling.false_positives))
    assert counts == [1, 2, 3, 3, 3, 3]
    changing, seen = noiser(positives(1.0, 1.0)), []
    for _ in range(50):
        changing.apply(TARGET)
        assert len(changing.false_positives) == 1
        seen += changing.false_positives
    assert len(set(seen)) > 45
    none_allowed = noiser(positives(1.0, 0.0, most=0))
    blind = noiser(MaskNoise(false_negative_rate=1.0))
    lasting = noiser(MaskNoise(partial_rate=1.0, partial_dismissal=0.0))
    first = lasting.apply(TARGET)
    assert 0 < np.count_nonzero(first) < 240
    for _ in range(50):
        assert np.array_equal(none_allowed.apply(TARGET), TARGET)
        assert not blind.apply(TARGET).any()
        assert np.array_equal(lasting.apply(TARGET), first)


def test_an_empty_target_mask_is_fine() -> None:
    one = noiser(NOISY)
    for _ in range(500):
        assert np.array_equal(one.apply(NO_TARGET), union(one.false_positives))


@pytest.mark.parametrize(
    "bad",
    [
        *({name: value} for name in ("false_positive_rate", "false_negative_rate") for value in (-0.1, 1.1, np.nan)),
        *({name: 1.5} for name in ("false_positive_dismissal", "partial_rate", "partial_dismissal")),
        {"max_false_positives": -1},
        {"false_positive_side_px": (0, 5)},
        {"false_positive_side_px": (6, 5)},
        {"partial_share": (0.0, 0.5)},
        {"partial_share": (0.6, 0.5)},
        {"partial_share": (0.5, 2.1)},
    ],
    ids=str,
)
def test_bad_parameters_raise(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must"):
        MaskNoise(**bad)  # type: ignore[arg-type]
