"""A segmentation model in ONNX whose metadata says how its input is to be prepared (see models/README.md)."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from distloc.camera import Camera
from distloc.types import CameraPose, RejectReason
from service.config import ConfigError
from service.messages import Frame
from service.segment_classical import is_flooded

_KEYS = (
    *("input_width", "input_height", "layout", "colour", "scale", "mean", "std"),
    *("output", "classes", "smoke_class", "version"),
)
_MAX_SIDE = 8192
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ModelCard:
    """A model's metadata, checked: x = (pixel * scale - mean) / std per channel, in the model's colour order."""

    width: int
    height: int
    is_nchw: bool
    is_rgb: bool
    scale: float
    mean: NDArray[np.float32]
    std: NDArray[np.float32]
    is_logits: bool
    classes: tuple[str, ...]
    smoke_index: int
    version: str


class OnnxSegmenter:
    """Runs a model on whole frames; the mask has the least whole fraction of the camera's size that holds its detail.

    Raises ConfigError, naming what is lacking, for a model that cannot be used. `provider` is the one really got.
    """

    def __init__(
        self,
        path: Path,
        camera: Camera,
        threshold: float,
        providers: Sequence[str] | None = None,
        flood_share: float = 1.0,
    ) -> None:
        self._session = _session(path, providers)
        self.card = _card(path, dict(self._session.get_modelmeta().custom_metadata_map))
        self._input = _checked_input(path, self._session, self.card)
        self.provider: str = self._session.get_providers()[0]
        wanted = (providers or onnxruntime.get_available_providers())[0]
        if wanted != self.provider:
            _log.warning("segmenter runs on %s, as %s cannot be had", self.provider, wanted)
        self.name = f"onnx {path.stem} {self.card.version}"
        self._threshold = threshold
        self._flood_share = flood_share
        self._size = _mask_size(camera, self.card.width)

    def segment(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.uint8] | RejectReason:
        """The mask; SEGMENTATION_FAILED where the model fails or gives numbers that are none."""
        if frame.image is None or frame.image.ndim != 3 or frame.image.shape[2] != 3 or frame.image.size == 0:
            return RejectReason.BAD_FRAME
        try:
            output = np.asarray(
                self._session.run(None, {self._input: self._prepared(frame.image)})[0], dtype=np.float32
            )
        except Exception as error:  # ONNX Runtime's errors have no common base below Exception
            _log.debug("the model failed: %s", error)
            return RejectReason.SEGMENTATION_FAILED
        smoke = _smoke(output, self.card)
        if smoke is None or not np.isfinite(smoke).all():
            return RejectReason.SEGMENTATION_FAILED
        resized = cv2.resize(smoke, self._size, interpolation=cv2.INTER_LINEAR)
        mask = np.where(resized > self._threshold, 255, 0).astype(np.uint8)
        return RejectReason.SEGMENTATION_FLOODED if is_flooded(mask, self._flood_share) else mask

    def _prepared(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        card = self.card
        shrinks = image.shape[1] > card.width
        small = cv2.resize(
            image, (card.width, card.height), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
        )
        ordered = cv2.cvtColor(small, cv2.COLOR_BGR2RGB) if card.is_rgb else small
        values = (ordered.astype(np.float32) * np.float32(card.scale) - card.mean) / card.std
        return np.ascontiguousarray((values.transpose(2, 0, 1) if card.is_nchw else values)[None], dtype=np.float32)


def _session(path: Path, providers: Sequence[str] | None) -> Any:
    if not path.is_file():
        raise ConfigError(f"segmenter.model is {str(path)!r}: no such file")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 2
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # spinning costs half as much CPU again
    options.log_severity_level = 3
    available = onnxruntime.get_available_providers()
    usable = [provider for provider in providers or available if provider in available] or ["CPUExecutionProvider"]
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=usable)
    except Exception as error:  # ONNX Runtime's errors have no common base below Exception
        line = str(error).splitlines()[0][:200]
        raise ConfigError(f"segmenter.model is {str(path)!r}: not a model that can be run: {line}") from error


def _card(path: Path, metadata: dict[str, str]) -> ModelCard:
    lacking = [f"distloc.{key}" for key in _KEYS if not metadata.get(f"distloc.{key}", "").strip()]
    if lacking:
        raise ConfigError(f"segmenter.model is {str(path)!r}: its metadata lacks {', '.join(lacking)}")
    value = {key: metadata[f"distloc.{key}"].strip() for key in _KEYS}
    classes = tuple(name.strip() for name in value["classes"].split(","))
    try:
        card = ModelCard(
            width=_side(value["input_width"]),
            height=_side(value["input_height"]),
            is_nchw=_one_of(value["layout"], "NCHW", "NHWC"),
            is_rgb=_one_of(value["colour"], "RGB", "BGR"),
            scale=float(_numbers(value["scale"])[0]),
            mean=_numbers(value["mean"]),
            std=_numbers(value["std"]),
            is_logits=_one_of(value["output"], "logits", "probability"),
            classes=classes,
            smoke_index=classes.index(value["smoke_class"]),
            version=value["version"],
        )
    except ValueError as error:
        raise ConfigError(f"segmenter.model is {str(path)!r}: its metadata is wrong: {error}") from error
    if (card.std == 0.0).any():
        raise ConfigError(f"segmenter.model is {str(path)!r}: its metadata is wrong: distloc.std has a 0")
    return card


def _checked_input(path: Path, session: Any, card: ModelCard) -> str:
    first = session.get_inputs()[0]
    wanted = [1, 3, card.height, card.width] if card.is_nchw else [1, card.height, card.width, 3]
    fits = len(first.shape) == 4 and all(
        not isinstance(a, int) or a == b for a, b in zip(first.shape, wanted, strict=False)
    )
    if not fits or len(session.get_inputs()) != 1 or first.type != "tensor(float)":
        raise ConfigError(
            f"segmenter.model is {str(path)!r}: its input is {first.type} {first.shape}: "
            f"by its metadata it is float {wanted}"
        )
    return str(first.name)


def _smoke(output: NDArray[np.float32], card: ModelCard) -> NDArray[np.float32] | None:
    """The smoke's probability (h, w) from an output (1, C, h, w), (1, h, w, C) or (1, h, w); None for another shape."""
    if output.ndim == 4:
        scores = output[0] if card.is_nchw else output[0].transpose(2, 0, 1)
    elif output.ndim == 3 and output.shape[0] == 1:
        scores = output
    else:
        return None
    if scores.shape[0] == 1:
        only = scores[0]
        probability = 1.0 / (1.0 + np.exp(-np.clip(only, -60.0, 60.0))) if card.is_logits else only
        return np.asarray(probability, dtype=np.float32)
    if scores.shape[0] != len(card.classes):
        return None
    if not card.is_logits:
        return np.asarray(scores[card.smoke_index], dtype=np.float32)
    powers = np.exp(scores - scores.max(axis=0))
    return np.asarray(powers[card.smoke_index] / powers.sum(axis=0), dtype=np.float32)


def _mask_size(camera: Camera, model_width: int) -> tuple[int, int]:
    """The smallest whole fraction (width, height) of the camera's size that is no coarser than the model."""
    fits = [k for k in range(1, max(1, camera.width // model_width) + 1) if camera.width % k == 0 == camera.height % k]
    return camera.width // fits[-1], camera.height // fits[-1]


def _side(text: str) -> int:
    side = int(text)
    if not 8 <= side <= _MAX_SIDE:
        raise ValueError(f"a side of the input must be 8 to {_MAX_SIDE} pixels, is {side}")
    return side


def _one_of(text: str, true: str, false: str) -> bool:
    if text not in (true, false):
        raise ValueError(f"must be {true} or {false}, is {text}")
    return text == true


def _numbers(text: str) -> NDArray[np.float32]:
    numbers = np.array([float(part) for part in text.split(",")], dtype=np.float32)
    if numbers.size not in (1, 3) or not np.isfinite(numbers).all():
        raise ValueError(f"must be 1 or 3 finite numbers, is {text}")
    return numbers
