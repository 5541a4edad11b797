"""A user's model in ONNX as a segmenter: the card says how (see models/README.md), tiles find what is small."""

import logging
import os
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose, RejectReason
from service.common.messages import Frame
from service.config.sections import ConfigError, SegmenterConfig
from service.segmenters.accelerator.accelerator import Accelerating, NoAccelerator
from service.segmenters.accelerator.assignment import short
from service.segmenters.accelerator.protocol import Plan
from service.segmenters.classical import is_flooded
from service.segmenters.model_card import ModelCard, model_card
from service.segmenters.model_input import Placement, levels, levels_fault, placements, prepared
from service.segmenters.model_output import Output, add_probability
from service.segmenters.model_session import CPU, ModelError, ModelSession, accelerators, is_fixed
from service.segmenters.still_view import StillView, with_changed

_GREY = 114
_FAR, _FAR_SHARE = 0.25, 0.01  # two providers agree where no more than this share of the mask is so far apart
_OFF_SHARE = 0.05  # of an output's own spread: 16 bits cost a tenth of it
PROVED_EACH = 200  # frames: two runs more of the model on the CPU
_log = logging.getLogger(__name__)


class OnnxSegmenter:
    """Runs a model on frames; the mask has the least whole fraction of the camera's size that holds its detail.

    Runs it once at the start: ConfigError, in one line, for a model that does not fit its card. An `accelerator` takes
    over once it has seen in a frame what the model's own session sees, and is asked so again each PROVED_EACH frames.
    """

    def __init__(
        self, model: ModelSession, camera: Camera, config: SegmenterConfig, accelerator: Accelerating | None = None
    ) -> None:
        self.card = model_card(model.path, model.metadata, config.preprocessing)
        self.accelerator = accelerator or NoAccelerator()
        self.threshold = config.threshold or self.card.threshold
        self._model, self._config, self._flood_share = model, config, config.flood_share
        self._view = StillView(camera) if self.card.faint_threshold < 1.0 else None
        self._levels = levels(self.card)
        if fault := levels_fault(self._levels, self.card, model.takes_uint8):
            raise ConfigError(f"segmenter.model is {str(model.path)!r}: {fault}")
        self._frame_size = camera.width, camera.height
        self._unproved = 0  # frames that an accelerator saw since it was compared
        self._given: dict[tuple[int, ...], tuple[int, ...]] = {}  # compared inputs' shapes: the first output's
        self._size = _mask_size(camera, self.placements(camera.width, camera.height))
        try:
            self._names = _output_names(model, self.card)
            self._try_out(camera)
            plan = self._plan(camera)
            self._planned = frozenset(plan.shapes)
            self.accelerator.plan(plan)
        except ModelError as error:
            raise ConfigError(f"segmenter.model is {str(model.path)!r}: {error}") from error

    @property
    def provider(self) -> str:
        """What runs the model now."""
        state = self.accelerator.state
        return state.provider if state.state == "used" else self._model.provider

    @property
    def name(self) -> str:
        """The model's, its version's and the provider's."""
        version = f" {self.card.version}" if self.card.version else ""
        return f"onnx {self._model.path.stem}{version} on {short(self.provider)}"

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
        return RejectReason.SEGMENTATION_FLOODED if is_flooded(mask, self._flood_share) else mask

    def change(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.float32] | None:
        """How much the view has changed (StillView), where the model has a threshold for what has; once a frame."""
        return None if self._view is None else self._view.change(frame, pose)

    def mask(
        self, probability: NDArray[np.float32], threshold: float, change: NDArray[np.float32] | None
    ) -> NDArray[np.uint8]:
        """Smoke is over the threshold, over that of outlines round such, or over that of the faint and has changed.

        Where so much is faint that it floods the mask, the faint is haze: what is over the threshold is left.
        """
        core = probability > threshold
        mask = _outlined(core, probability > min(threshold, self.card.outline_threshold))
        mask = with_changed(mask, probability > self.card.faint_threshold, change)
        return np.where(core, 255, 0).astype(np.uint8) if is_flooded(mask, self._flood_share) else mask

    def probability(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The smoke's probability (h, w) at the mask's size; ModelError where the model fails."""
        if self._is_due(image):
            return self._proved(image)
        try:
            return self._total(image, self.run)
        except ModelError as error:
            if self.accelerator.state.state != "used":
                raise
            own = self.own_probability(image)  # fails as well: then it is the model's fault
            self.accelerator.judge(str(error))
            return own

    def own_probability(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """As `probability`, of the model's own session whatever else there is."""
        return self._total(image, self._run_own)

    def settle(self, image: NDArray[np.uint8]) -> None:
        """Wait for the accelerator, and have it proved on an image: for commands, which have the time."""
        if not self._is_planned(image):
            image = np.full((self._frame_size[1], self._frame_size[0], 3), _GREY, np.uint8)
        self.accelerator.settle()
        while self.accelerator.state.state == "proving":
            self.probability(image)
            self.accelerator.settle()

    def placements(self, width: int, height: int) -> list[Placement]:
        """The windows of a frame of that size that are run, the whole frame first."""
        return placements(self.card, width, height, self._config.tiles, self._config.tile_overlap)

    def run(self, image: NDArray[np.uint8], place: Placement) -> Output:
        """The model's output for one window; ModelError where it fails."""
        values = self._prepared(image, place)
        wanted = self._given.get(values.shape)
        outputs = None if wanted is None else self.accelerator.run(values)
        if wanted is None or outputs is None:
            return Output(*self._model.outputs_of(values, self._names))
        if self.card.output != "boxes" and outputs[0].shape != wanted:
            raise ModelError(f"its output is {_sides(outputs[0].shape)}, that of the CPU {_sides(wanted)}")
        return Output(*outputs)

    def _run_own(self, image: NDArray[np.uint8], place: Placement) -> Output:
        values = self._prepared(image, place)
        outputs = self._model.outputs_of(values, self._names)
        if values.shape in self._planned:
            self._given[values.shape] = outputs[0].shape
        return Output(*outputs)

    def _run_accelerated(self, image: NDArray[np.uint8], place: Placement) -> Output:
        outputs = self.accelerator.run(self._prepared(image, place), is_proof=True)
        if outputs is None:
            raise ModelError("it gave nothing where it was compared with the CPU")
        return Output(*outputs)

    def _is_due(self, image: NDArray[np.uint8]) -> bool:
        """Whether an accelerator is to be compared with the CPU on this frame, which it can run."""
        state = self.accelerator.state.state
        self._unproved = self._unproved + 1 if state == "used" else 0
        return (state == "proving" or self._unproved >= PROVED_EACH) and self._is_planned(image)

    def _is_planned(self, image: NDArray[np.uint8]) -> bool:
        places = self.placements(image.shape[1], image.shape[0])
        return all(_input_shape(self.card, place) in self._planned for place in places)

    def _proved(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """The own session's probability, with the accelerator's beside it to judge that by."""
        self._unproved = 0
        own = self.own_probability(image)
        try:
            fault = self._fault_on_noise(*image.shape[:2])
            self.accelerator.judge(fault or disagreement(own, self._total(image, self._run_accelerated)))
        except ModelError as error:
            self.accelerator.judge(str(error))
        return own

    def _fault_on_noise(self, height: int, width: int) -> str:
        """Why the accelerator does not compute what the own session does: smoke or not, noise moves every output."""
        noise = np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)
        place = self.placements(width, height)[0]
        return difference(self._run_own(noise, place).first, self._run_accelerated(noise, place).first)

    def _prepared(self, image: NDArray[np.uint8], place: Placement) -> NDArray[np.float32]:
        return prepared(image, place, self.card, self._levels)

    def _total(
        self, image: NDArray[np.uint8], run: Callable[[NDArray[np.uint8], Placement], Output]
    ) -> NDArray[np.float32]:
        total = np.zeros(self._size[::-1], np.float32)
        for place in self.placements(image.shape[1], image.shape[0]):
            add_probability(total, run(image, place), self.card, place, self.threshold)
        return total

    def _plan(self, camera: Camera) -> Plan:
        """What an accelerator will run: inputs of fixed sizes, those that frames of the camera's size give."""
        places, port = self.placements(camera.width, camera.height), self._model.inputs[0]
        shapes = tuple(sorted({_input_shape(self.card, place) for place in places}))
        free = {side: length for side, length in zip(port.shape, shapes[0], strict=True) if isinstance(side, str)}
        return Plan(
            model=str(self._model.path.absolute()),
            sha256=self._config.sha256,
            providers=(*accelerators(self._config.providers), CPU),
            input_name=port.name,
            outputs=tuple(self._names),
            shapes=shapes,
            sides=free if len(shapes) == 1 else {},
            fp16=self._config.fp16,
            engines=_engines_folder(),
        )

    def _try_out(self, camera: Camera) -> None:
        place = self.placements(camera.width, camera.height)[0]
        _check_input(self._model, self.card, place)
        output = self.run(np.full((camera.height, camera.width, 3), _GREY, np.uint8), place)
        nothing = Output(np.zeros_like(output.first), output.prototypes)
        add_probability(np.zeros(self._size[::-1], np.float32), nothing, self.card, place, self.threshold)


def disagreement(own: NDArray[np.float32], other: NDArray[np.float32]) -> str:
    """Why another provider's probabilities (h, w) are not those of the CPU; empty where they are."""
    share = float(np.mean(~(np.abs(own - other) <= _FAR)))  # NaN is far from all
    if share <= _FAR_SHARE:
        return ""
    return f"in {share:.1%} of the mask its probabilities are over {_FAR} off those of the CPU"


def difference(own: NDArray[np.float32], other: NDArray[np.float32]) -> str:
    """Why another provider's output is not that of the CPU, but for rounding; empty where it is."""
    if own.shape != other.shape:
        return f"its output is {_sides(other.shape)}, that of the CPU {_sides(own.shape)}"
    if not own.size:
        return ""
    off = float(np.sqrt(np.mean(np.square(other - own, dtype=np.float64))))
    spread = float(np.std(own, dtype=np.float64))
    if off <= _OFF_SHARE * spread + 1e-3 * float(np.abs(own).max()) + 1e-6:
        return ""
    return f"on noise its output is {off:.3g} off that of the CPU, which varies by {spread:.3g}"


def _sides(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _input_shape(card: ModelCard, place: Placement) -> tuple[int, int, int, int]:
    height, width = place.down.side, place.across.side
    return (1, 3, height, width) if card.is_nchw else (1, height, width, 3)


def _engines_folder() -> str:
    """In the service's state directory; empty without one: root, who runs the doctor, takes no engine of others."""
    folder = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return f"{folder}/engines" if folder else ""


def _outlined(core: NDArray[np.bool_], outline: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The segments of `outline` (h, w) that hold some of `core` (h, w), which lies in it (Canny's hysteresis)."""
    if not core.any():
        return np.zeros(core.shape, np.uint8)
    count, labels = cv2.connectedComponents(outline.astype(np.uint8))
    is_held = np.zeros(count, np.bool_)
    is_held[labels[core]] = True
    return np.where(is_held[labels], 255, 0).astype(np.uint8)


def _check_input(model: ModelSession, card: ModelCard, place: Placement) -> None:
    port, wanted = model.inputs[0], _input_shape(card, place)
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
