"""What a model takes and gives: its metadata, overridden by the config, checked; read by the ONNX segmenter."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from service.config.explained import explained
from service.config.sections import ConfigError, PreprocessingConfig
from service.segmenters.exporter_card import exporter_keys

REQUIRED = (
    *("input_width", "input_height", "layout", "colour", "scale", "mean", "std"),
    *("output", "classes", "smoke_class"),
)
PREFIX = "distloc."
_MULTIPLE, _THRESHOLD = 32, 0.5  # most networks halve their input five times; the likelier of smoke and none
_LISTS = ("mean", "std", "classes")  # with commas in metadata, which has only text


@dataclass(frozen=True, slots=True)
class ModelCard:
    """x = (pixel * scale - mean) / std per channel, in the model's colour order; sizes in pixels."""

    width: int
    height: int
    is_nchw: bool
    is_rgb: bool
    scale: float
    mean: NDArray[np.float32]
    std: NDArray[np.float32]
    output: Literal["logits", "probability", "boxes"]
    classes: tuple[str, ...]
    smoke_index: int
    version: str
    resize: Literal["stretch", "letterbox", "budget"]
    multiple: int
    threshold: float
    outline_threshold: float  # how far a segment reaches that has some of over `threshold`; 1: no farther
    faint_threshold: float  # of what has changed in a view that stands still; 1: none
    output_name: str  # empty: the first
    is_output_nchw: bool
    boxes: Literal["yolov8", "yolov5", "end-to-end"] | None  # None: told by the output's shape


def model_card(path: Path, metadata: dict[str, str], config: PreprocessingConfig) -> ModelCard:
    """The card of the model at `path`; ConfigError in one line that names the keys that lack or are wrong."""
    known = msgspec.structs.replace(_stated(path, metadata), **_given(config))
    lacking = [key for key in REQUIRED if getattr(known, key) is None]
    if lacking:
        among = f" (its classes are {', '.join(known.classes)!r:.200})" if known.classes else ""
        raise ConfigError(
            f"segmenter.model is {str(path)!r}: its metadata lacks {', '.join(PREFIX + key for key in lacking)}; "
            f"add them to the model or as [segmenter.preprocessing] to the config{among}"
        )
    try:
        return _checked(known)
    except ValueError as error:
        raise ConfigError(f"segmenter.model is {str(path)!r}: {error}") from error


def _stated(path: Path, metadata: dict[str, str]) -> PreprocessingConfig:
    """The keys that the model's metadata has, or that follow from its exporter's; text becomes numbers."""
    try:
        stated = exporter_keys(metadata)
    except ValueError as error:
        raise ConfigError(f"segmenter.model is {str(path)!r}: {error}") from error
    for key in PreprocessingConfig.__struct_fields__:
        text = metadata.get(PREFIX + key, "").strip()
        if text:
            stated[key] = [part.strip() for part in text.split(",")] if key in _LISTS else text
    try:
        return msgspec.convert(stated, PreprocessingConfig, strict=False)
    except msgspec.ValidationError as error:
        wrong = explained(error, stated, PreprocessingConfig)
        raise ConfigError(f"segmenter.model is {str(path)!r}: its metadata is wrong: {PREFIX}{wrong}") from error


def _given(config: PreprocessingConfig) -> dict[str, Any]:
    return {key: value for key, value in msgspec.structs.asdict(config).items() if value is not None}


def _checked(known: PreprocessingConfig) -> ModelCard:
    classes = known.classes or ()
    if known.smoke_class not in classes:
        raise ValueError(
            f"smoke_class is {known.smoke_class!r:.60}: it must be one of the classes {', '.join(classes)!r:.300}"
        )
    std = _channels("std", known.std)
    if (std == 0.0).any():
        raise ValueError(f"std is {known.std}: it has a 0")
    return ModelCard(
        width=known.input_width or 0,
        height=known.input_height or 0,
        is_nchw=known.layout == "NCHW",
        is_rgb=known.colour == "RGB",
        scale=float(known.scale or 1.0),
        mean=_channels("mean", known.mean),
        std=std,
        output=known.output or "logits",
        classes=classes,
        smoke_index=classes.index(known.smoke_class),
        version=known.version or "",
        resize=known.resize or "stretch",
        multiple=known.multiple or _MULTIPLE,
        threshold=known.threshold or _THRESHOLD,
        outline_threshold=known.outline_threshold or 1.0,
        faint_threshold=known.faint_threshold or 1.0,
        output_name=known.output_name or "",
        is_output_nchw=(known.output_layout or known.layout) == "NCHW",
        boxes=known.boxes,
    )


def _channels(key: str, value: float | tuple[float, ...] | None) -> NDArray[np.float32]:
    """(3,)."""
    with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused
        numbers = np.atleast_1d(np.asarray(value, dtype=np.float32))
    if numbers.size not in (1, 3) or not np.isfinite(numbers).all():
        raise ValueError(f"{key} is {value!s:.60}: it must be 1 or 3 finite numbers")
    return np.broadcast_to(numbers, 3)
