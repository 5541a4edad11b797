"""What a segmenter gets wrong, frame by frame, as the paper's section "Problem Setup" states it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import FloatArray


@dataclass(frozen=True, slots=True)
class MaskNoise:
    """Rates are per frame, in [0, 1]; the defaults have no noise.

    The paper does not say how large its random sections are: a rectangle's sides are uniform within
    `false_positive_side_px`, a partial negative's within `partial_share` of the target's bounding box, about a random
    point of it and cut off at its edges: it can take a corner, a side or nearly all of the target away.
    """

    false_positive_rate: float = 0.0
    false_positive_dismissal: float = 0.2
    max_false_positives: int = 3
    false_negative_rate: float = 0.0
    partial_rate: float = 0.0
    partial_dismissal: float = 0.2
    false_positive_side_px: tuple[int, int] = (10, 100)
    partial_share: tuple[float, float] = (0.25, 1.25)

    def __post_init__(self) -> None:
        rates = (
            self.false_positive_rate,
            self.false_positive_dismissal,
            self.false_negative_rate,
            self.partial_rate,
            self.partial_dismissal,
        )
        counts = (self.max_false_positives, *self.false_positive_side_px)
        if not all(0.0 <= rate <= 1.0 for rate in rates) or not all(isinstance(n, int) and n >= 0 for n in counts):
            raise ValueError(f"rates must be within 0 and 1, max_false_positives and sides whole and >= 0, got {self}")
        if not (
            1 <= self.false_positive_side_px[0] <= self.false_positive_side_px[1]
            and 0.0 < self.partial_share[0] <= self.partial_share[1] <= 2.0
        ):
            raise ValueError(f"sizes must rise, sides from 1 px, shares above 0 up to 2, got {self}")


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Pixels left <= u < right, top <= v < bottom."""

    left: int
    top: int
    right: int
    bottom: int


class MaskNoiser:
    """Carries false positives and the partial negative from frame to frame.

    In each frame what is there is dismissed at its rate, then something new may appear: at most one false positive and
    one partial negative a frame. What appears stays at least for its first frame.
    """

    def __init__(self, noise: MaskNoise, camera: Camera, rng: np.random.Generator) -> None:
        self.false_positives: list[Rectangle] = []
        self.partial: tuple[FloatArray, FloatArray] | None = None  # corners (2,) as shares of the target's box
        self.is_false_negative = False
        self._partial_of: int | None = None
        self._noise = noise
        self._size = (camera.width, camera.height)
        # a generator for each kind: switching one on leaves the others' draws as they were
        self._fp_rng, self._fn_rng, self._partial_rng = rng.spawn(3)

    def apply(self, target_mask: NDArray[np.uint8], *others: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The next frame's noisy mask (H, W) from the targets' own, one each; those stay as they are.

        A false negative empties the targets' pixels, and leaves false positives, as the paper has it. A partial
        negative is a section of one target.
        """
        target_masks = (target_mask, *others)
        self._advance(len(target_masks))
        mask = np.zeros_like(target_mask)
        if not self.is_false_negative:
            for index, target in enumerate(target_masks):
                mask |= self._without_partial(target) if index == self._partial_of else target
        for one in self.false_positives:
            mask[one.top : one.bottom, one.left : one.right] = 255
        return mask

    def _advance(self, targets: int) -> None:
        noise, rng = self._noise, self._fp_rng
        self.false_positives = [one for one in self.false_positives if rng.random() >= noise.false_positive_dismissal]
        if rng.random() < noise.false_positive_rate and len(self.false_positives) < noise.max_false_positives:
            self.false_positives.append(self._random_rectangle())
        self.is_false_negative = bool(self._fn_rng.random() < noise.false_negative_rate)
        rng = self._partial_rng
        if self.partial is not None and rng.random() < noise.partial_dismissal:
            self.partial, self._partial_of = None, None
        if self.partial is None and rng.random() < noise.partial_rate:
            self._partial_of = int(rng.integers(targets)) if targets > 1 else 0
            self.partial = self._random_section()

    def _random_rectangle(self) -> Rectangle:
        low, high = self._noise.false_positive_side_px
        width, height = (min(int(self._fp_rng.integers(low, high + 1)), size) for size in self._size)
        left = int(self._fp_rng.integers(0, self._size[0] - width + 1))
        top = int(self._fp_rng.integers(0, self._size[1] - height + 1))
        return Rectangle(left, top, left + width, top + height)

    def _random_section(self) -> tuple[FloatArray, FloatArray]:
        rng = self._partial_rng
        while True:
            half = rng.uniform(*self._noise.partial_share, size=2) / 2.0
            middle = rng.uniform(0.0, 1.0, size=2)
            first, last = np.maximum(middle - half, 0.0), np.minimum(middle + half, 1.0)
            if not (last - first == 1.0).all():
                return first, last

    def _without_partial(self, target_mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
        columns, rows = np.flatnonzero(target_mask.any(axis=0)), np.flatnonzero(target_mask.any(axis=1))
        if self.partial is None or columns.size == 0:
            return target_mask
        first, last = self.partial
        left, across = int(columns[0]), int(columns[-1] - columns[0] + 1)
        top, down = int(rows[0]), int(rows[-1] - rows[0] + 1)
        size = np.array([across, down])
        u0, v0 = np.minimum(np.round(first * size).astype(int), size - 1)
        u1, v1 = np.maximum(np.round(last * size).astype(int), [u0 + 1, v0 + 1])
        mask = target_mask.copy()
        mask[top + v0 : top + v1, left + u0 : left + u1] = 0
        return mask
