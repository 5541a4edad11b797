"""A model whose numbers cannot be meant is refused: what a frame's pixels become must be what networks take."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from service.config.sections import PreprocessingConfig
from service.segmenters.model_card import model_card
from service.segmenters.model_input import levels, levels_fault

STATED = PreprocessingConfig(
    input_width=64,
    input_height=64,
    layout="NCHW",
    colour="RGB",
    scale=1.0,
    mean=0.0,
    std=1.0,
    output="logits",
    classes=("smoke",),
    smoke_class="smoke",
)
IMAGENET = {"mean": (0.485, 0.456, 0.406), "std": (0.229, 0.224, 0.225)}
OF_255 = {"mean": (123.675, 116.28, 103.53), "std": (58.395, 57.12, 57.375)}


def fault(is_uint8: bool, **given: Any) -> str:

    card = model_card(Path("x.onnx"), {}, msgspec.structs.replace(STATED, **given))
    return levels_fault(levels(card), card, is_uint8)


@pytest.mark.parametrize(
    "given",
    [{}, {"scale": 1 / 255}, {"scale": 1 / 255, **IMAGENET}, OF_255, {"mean": 127.5, "std": 127.5}, {"std": 0.5}],
)
def test_what_networks_take_is_taken(given: dict[str, Any]) -> None:
    assert fault(False, **given) == ""


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (IMAGENET, "scale 1, mean 0.406, 0.456, 0.485"),
        ({"scale": 1 / 255, **OF_255}, "scale 0.00392157, mean 103.53"),
        ({"scale": 1 / 255, "std": 255.0}, "which no network takes"),
        ({"scale": 255.0}, "which no network takes"),
    ],
)
def test_a_scale_that_lacks_or_is_there_twice_is_refused(given: dict[str, Any], says: str) -> None:
    said = fault(False, **given)
    assert says in said and "mean and std are of pixels after the scale" in said and "\n" not in said


@pytest.mark.parametrize("given", [{}, {"scale": 0.5, "std": 0.5}])
def test_uint8_takes_pixels_as_they_are(given: dict[str, Any]) -> None:
    assert fault(True, **given) == ""


@pytest.mark.parametrize(
    "given", [{"scale": 1 / 255}, {"mean": 128.0}, {"scale": 2.0}, IMAGENET, {"scale": 1 / 255, "std": 1 / 16}]
)
def test_uint8_takes_nothing_else(given: dict[str, Any]) -> None:
    said = fault(True, **given)
    assert said.startswith("its input is uint8, and scale") and "cut to whole" in said
