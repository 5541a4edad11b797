"""Segmenters: from a frame to a mask of smoke; the pipeline calls one for each frame."""

from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, RejectReason
from service.camera.sources import fits
from service.common.files import FileRefusedError
from service.common.masks import MaskFolder
from service.common.messages import Frame
from service.config.sections import ConfigError, SegmenterConfig
from service.segmenters.accelerator.accelerator import Accelerating, Accelerator, NoAccelerator
from service.segmenters.classical import ClassicalSegmenter, is_flooded

Mask = NDArray[np.uint8]

__all__ = [
    "ClassicalSegmenter",
    "Mask",
    "RecordedSegmenter",
    "Segmenter",
    "SobelSegmenter",
    "make_segmenter",
    "shipped_model",
]

_EDGE_SHARE = 0.25  # of the strongest possible edge; a mast against the sky gives over a third


class Segmenter(Protocol):
    """Gives a mask (h, w), 0 or 255, of the camera's full size or a whole fraction of it, or why there is none."""

    @property
    def name(self) -> str:
        """What made the masks, for the status."""
        ...

    def segment(self, frame: Frame, pose: CameraPose | None) -> Mask | RejectReason:
        """The smoke in a frame; the pose helps where it is known."""
        ...


class SobelSegmenter:
    """Thin upright things such as masts: horizontal Sobel, a threshold, then erosion and dilation along the column."""

    def __init__(self, camera: Camera, flood_share: float = 0.5) -> None:
        self.name = "sobel"
        self._camera = camera
        self._flood_share = flood_share

    def segment(self, frame: Frame, pose: CameraPose | None) -> Mask | RejectReason:
        """The mask at the frame's size; BAD_FRAME without an image."""
        if frame.image is None or frame.image.ndim != 3:
            return RejectReason.BAD_FRAME
        grey = cv2.GaussianBlur(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), (3, 3), 0)
        edges = np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3))
        strong = np.where(edges > _EDGE_SHARE * 4.0 * 255.0, 255, 0).astype(np.uint8)
        # the two edges of a thin mast join, then only what is long and upright stays
        joined = cv2.morphologyEx(strong, cv2.MORPH_CLOSE, np.ones((1, 5), np.uint8))
        upright = cv2.dilate(cv2.erode(joined, np.ones((9, 1), np.uint8)), np.ones((11, 3), np.uint8))
        mask = np.asarray(upright, dtype=np.uint8)
        return RejectReason.SEGMENTATION_FLOODED if is_flooded(mask, self._flood_share) else mask


class RecordedSegmenter:
    """Masks that were made before: `<folder>/<stem of the frame's name>.png` at the camera's size or a whole fraction.

    What is smoke in them, `service.common.masks` says. `faint` counts masks with pixels of which none is smoke so.
    """

    def __init__(self, folder: Path, camera: Camera) -> None:
        self.name = "recorded"
        self.faint = 0
        self._masks = MaskFolder(folder, camera.width * camera.height)
        self._camera = camera

    def segment(self, frame: Frame, pose: CameraPose | None) -> Mask | RejectReason:
        """The recorded mask; FRAME_MISSING where there is none, BAD_FRAME where it cannot be used."""
        if not self._masks.has(frame.name):
            return RejectReason.FRAME_MISSING
        try:
            smoke = self._masks.smoke(frame.name, frame.orientation, lambda mask: fits(self._camera, mask))
        except FileRefusedError:
            return RejectReason.BAD_FRAME
        self.faint += smoke.is_faint
        return np.where(smoke.region, 255, 0).astype(np.uint8)


def shipped_model() -> Path:
    """The model that comes with distloc: `models` lies beside this package in a checkout and once installed."""
    return Path(__file__).parents[2] / "models" / "smoke-seg.onnx"


def _shipped_model_there() -> Path:
    path = shipped_model()
    if not path.is_file():
        raise ConfigError(
            f"segmenter.model is empty: the model that ships is not where it was installed, {path}: install distloc "
            "anew, name a model, or take segmenter.kind = 'classical', which finds far less"
        )
    return path


def make_segmenter(
    config: SegmenterConfig,
    camera: Camera,
    recording: Path | None = None,
    accelerator: Accelerating | None = None,
) -> Segmenter:
    """The segmenter that a configuration asks for; `recording` is the recording's folder, for recorded masks.

    Who flies brings the `accelerator` (of `make_accelerator`), starts and closes it; without one a GPU is waited for.
    Raises ConfigError, naming the key, where a model or the masks are missing.
    """
    if config.kind == "recorded":
        folder = None if recording is None else recording / "masks"
        if folder is None or not folder.is_dir():
            raise ConfigError(
                f"segmenter.kind is 'recorded': no such folder {folder or 'masks, as nothing is replayed'}"
            )
        return RecordedSegmenter(folder, camera)
    if config.kind == "onnx":
        from service.segmenters.model_session import open_on_cpu
        from service.segmenters.onnx import OnnxSegmenter

        path = Path(config.model) if config.model else _shipped_model_there()
        chosen = accelerator or make_accelerator(config)
        segmenter = OnnxSegmenter(open_on_cpu(path, config.providers, config.sha256), camera, config, chosen)
        if accelerator is None:
            chosen.start()
            segmenter.settle(np.full((camera.height, camera.width, 3), 128, np.uint8))
        return segmenter
    if config.kind == "sobel":
        return SobelSegmenter(camera, config.flood_share)
    return ClassicalSegmenter(camera, config.flood_share)


def make_accelerator(config: SegmenterConfig, is_told: bool = True) -> Accelerating:
    """What takes over from the CPU; one that does nothing where no model runs or ONNX Runtime has no GPU provider.

    It logs what it does unless told otherwise.
    """
    if config.kind == "onnx":
        from service.segmenters.model_session import accelerators

        if accelerators(config.providers):
            return Accelerator(is_told=is_told)
    return NoAccelerator()
