"""A user's model in ONNX as a segmenter: the card says how (see models/README.md), tiles find what is small."""

import logging

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, RejectReason
from service.common.messages import Frame
from service.config.sections import ConfigError, SegmenterConfig
from service.segmenters.classical import is_flooded
from service.segmenters.model_card import ModelCard, model_card
from service.segmenters.model_input import Placement, levels, levels_fault, placements, prepared
from service.segmenters.model_output import Output, add_probability
from service.segmenters.model_session import ModelError, ModelSession, is_fixed
from service.segmenters.still_view import StillView, with_changed

_GREY = 114
_log = logging.getLogger(__name__)


class OnnxSegmenter:
    """Runs a model on frames; the mask has the least whole fraction of the camera's size that holds its detail.

    Runs it once at the start: ConfigError, in one line, for a model that does not fit its card.
    """

    def __init__(self, model: ModelSession, camera: Camera, config: SegmenterConfig) -> None:
        self.card = model_card(model.path, model.metadata, config.preprocessing)
        self.provider = model.provider
        version = f" {self.card.version}" if self.card.version else ""
        self.name = f"onnx {model.path.stem}{version} on {model.provider.removesuffix('ExecutionProvider')}"
        self.threshold = config.threshold or self.card.threshold
        self._model, self._config = model, config
        self._view = StillView(camera) if self.card.faint_threshold < 1.0 else None
        self._levels = levels(self.card)
        if fault := levels_fault(self._levels, self.card, model.takes_uint8):
            raise ConfigError(f"segmenter.model is {str(model.path)!r}: {fault}")
        self._size = _mask_size(camera, self.placements(camera.width, camera.height))
        try:
            self._names = _output_names(model, self.card)
            self._try_out(camera)
        except ModelError as error:
            raise ConfigError(f"segmenter.model is {str(model.path)!r}: {error}") from error

    def segment(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.uint8] | RejectReason:
        """The mask; SEGMENTATION_FAILED where the model fails or gives numbers that are none."""
        if frame.image is None or frame.image.ndim != 3 or frame.image.shape[2] != 3 or frame.image.size == 0:
            return RejectReason.BAD_FRAME
        try:
            probability = self.probability(frame.image)
        except ModelError as error:
            _log.debug("%s", error)
            return RejectReason.SEGMENTATION_FAILED
        mask = self.mask(probability, self.threshold, self.change(frame, pose))
        return RejectReason.SEGMENTATION_FLOODED if is_flooded(mask, self._config.flood_share) else mask

    def change(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.float32] | None:
        """How much the view has changed (StillView), where the model has a threshold for what has; once a frame."""
        return None if self._view is None else self._view.change(frame, pose)

    def mask(
        self, probability: NDArray[np.float32], threshold: float, change: NDArray[np.float32] | None
    ) -> NDArray[np.uint8]:
        """Smoke is over the threshold, or over the outline's round what is, or over the faint one and has changed."""
        mask = _outlined(probability > threshold, probability > min(threshold, self.card.outline_threshold))
        return with_changed(mask, probability > self.card.faint_threshold, change)

    def probability(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The smoke's probability (h, w) at the mask's size; ModelError where the model fails."""
        total = np.zeros(self._size[::-1], np.float32)
        for place in self.placements(image.shape[1], image.shape[0]):
            add_probability(total, self.run(image, place), self.card, place, self.threshold)
        return total

    def placements(self, width: int, height: int) -> list[Placement]:
        """The windows of a frame of that size that are run, the whole frame first."""
        return placements(self.card, width, height, self._config.tiles, self._config.tile_overlap)

    def run(self, image: NDArray[np.uint8], place: Placement) -> Output:
        """The model's output for one window; ModelError where it fails."""
        return Output(*self._model.outputs_of(prepared(image, place, self.card, self._levels), self._names))

    def _try_out(self, camera: Camera) -> None:
        place = self.placements(camera.width, camera.height)[0]
        _check_input(self._model, self.card, place)
        output = self.run(np.full((camera.height, camera.width, 3), _GREY, np.uint8), place)
        nothing = Output(np.zeros_like(output.first), output.prototypes)
        add_probability(np.zeros(self._size[::-1], np.float32), nothing, self.card, place, self.threshold)


def _outlined(core: NDArray[np.bool_], outline: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The segments of `outline` (h, w) that hold some of `core` (h, w), which lies in it (Canny's hysteresis)."""
    if not core.any():
        return np.zeros(core.shape, np.uint8)
    count, labels = cv2.connectedComponents(outline.astype(np.uint8))
    is_held = np.zeros(count, np.bool_)
    is_held[labels[core]] = True
    return np.where(is_held[labels], 255, 0).astype(np.uint8)


def _check_input(model: ModelSession, card: ModelCard, place: Placement) -> None:
    port, (height, width) = model.inputs[0], (place.down.side, place.across.side)
    wanted = (1, 3, height, width) if card.is_nchw else (1, height, width, 3)
    if not port.takes(wanted):
        raise ModelError(f"its input is {port}: by its metadata it is {' x '.join(map(str, wanted))}")
    if card.resize == "budget" and any(map(is_fixed, port.shape[2:] if card.is_nchw else port.shape[1:3])):
        raise ModelError(f"its input is {port}: resize = 'budget' needs a free height and width")


def _output_names(model: ModelSession, card: ModelCard) -> list[str]:
    """The output that is used and, beside boxes, that of the masks' prototypes (1, K, h, w) where there is one."""
    names = [port.name for port in model.outputs]
    if card.output_name and card.output_name not in names:
        raise ModelError(f"output_name is {card.output_name!r}: its outputs are {', '.join(names)}")
    first = card.output_name or names[0]
    planes = [port.name for port in model.outputs if len(port.shape) == 4 and port.name != first]
    return [first, *planes[:1]] if card.output == "boxes" else [first]


def _mask_size(camera: Camera, places: list[Placement]) -> tuple[int, int]:
    """The smallest whole fraction (width, height) of the camera's size that is no coarser than any input."""
    width = max(place.across.inner * camera.width / place.across.length for place in places)
    height = max(place.down.inner * camera.height / place.down.length for place in places)
    most = max(1, int(min(camera.width / width, camera.height / height)))
    divisor = max(k for k in range(1, most + 1) if camera.width % k == 0 == camera.height % k)
    return camera.width // divisor, camera.height // divisor
