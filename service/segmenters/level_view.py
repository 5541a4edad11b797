"""A frame turned so that its horizon is level; the classical segmenter works on it row by row."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class HorizonLine:
    """A line through a frame: how far it sinks to the right, and how far below the centre it runs, in widths."""

    angle_rad: float
    offset: float


ALL_LAND = HorizonLine(0.0, -1000.0)  # the line is far above the frame


@dataclass(frozen=True, slots=True)
class LevelView:
    """One channel of a frame, level; rows before `horizon` are sky."""

    light: NDArray[np.uint8]  # (H, W)
    is_inside: NDArray[np.bool_]  # (H, W), where the frame is
    horizon: int  # a row, maybe outside
    frame_size: tuple[int, int]  # width, height
    view_from_frame: NDArray[np.float64]  # (2, 3), of pixels

    @property
    def unit(self) -> int:
        """The frame's width, which lengths are shares of."""
        return self.frame_size[0]

    def frame_from_view(self, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A mask of the view as one of the frame (h, w)."""
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpAffine(mask, self.view_from_frame, self.frame_size, flags=flags), dtype=np.uint8)


def level_view(light: NDArray[np.uint8], line: HorizonLine, margin: int) -> LevelView:
    """The whole frame (h, w) turned about its centre, with a margin on the left and the right and one row outside."""
    height, width = light.shape
    across, down = abs(np.sin(line.angle_rad)), abs(np.cos(line.angle_rad))
    # as many whole pixels more on both sides, so that a mask that was hardly turned comes back unshifted
    left = margin + round(0.5 * (width * down + height * across - width))
    above = 1 + round(0.5 * (width * across + height * down - height))
    size = (width + 2 * left, height + 2 * above)
    turn = cv2.getRotationMatrix2D((0.5 * (width - 1), 0.5 * (height - 1)), float(np.degrees(line.angle_rad)), 1.0)
    turn[:, 2] += (left, above)
    inside = cv2.warpAffine(np.ones_like(light), turn, size, flags=cv2.INTER_NEAREST)
    turned = cv2.warpAffine(light, turn, size, borderMode=cv2.BORDER_REPLICATE)
    horizon = round(0.5 * (size[1] - 1) + line.offset * width)
    return LevelView(np.asarray(turned, dtype=np.uint8), inside > 0, horizon, (width, height), np.asarray(turn))
