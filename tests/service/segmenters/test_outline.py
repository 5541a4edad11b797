"""A segment's edge may be fainter than what makes it a segment: `outline_threshold`."""

from pathlib import Path

import numpy as np
import pytest

from distloc.geometry.camera import Camera
from service.config.sections import ConfigError, SegmenterConfig
from service.segmenters.model_session import ModelSession
from service.segmenters.onnx import OnnxSegmenter
from tests.support.onnx_models import CARD, red_model

CAMERA = Camera(128, 64, 100.0, 100.0, 64.0, 32.0)


def segmenter(folder: Path, **card: str) -> OnnxSegmenter:
    config = SegmenterConfig(kind="onnx", providers=("CPUExecutionProvider",))
    return OnnxSegmenter(ModelSession(red_model(folder / "m.onnx", CARD | card), config.providers), CAMERA, config)


def two_plumes() -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    """0.55 over two rectangles, of which the left has 0.7 inside; 0.52 joins a far corner of it."""
    probability = np.zeros((64, 128), np.float32)
    probability[10:30, 10:40] = probability[10:30, 60:90] = 0.55
    probability[15:20, 15:20] = 0.7
    probability[30:40, 39] = 0.52
    return probability


def test_a_segment_reaches_as_far_as_its_outline_and_what_has_no_core_is_none(tmp_path: Path) -> None:
    probability = two_plumes()
    mask = segmenter(tmp_path, outline_threshold="0.5").mask(probability, 0.65, None) > 0
    assert np.array_equal(mask[:, :50], probability[:, :50] > 0.5) and not mask[:, 50:].any()


@pytest.mark.parametrize("card", [{}, {"outline_threshold": "0.9"}])
def test_without_one_or_with_a_higher_one_the_threshold_is_the_edge(tmp_path: Path, card: dict[str, str]) -> None:
    probability = two_plumes()
    mask = segmenter(tmp_path, **card).mask(probability, 0.65, None)
    assert np.array_equal(mask > 0, probability > 0.65)


def test_nothing_over_the_threshold_is_nothing(tmp_path: Path) -> None:
    assert not segmenter(tmp_path, outline_threshold="0.5").mask(two_plumes(), 0.8, None).any()


@pytest.mark.parametrize("is_changed", [False, True])
def test_haze_that_floods_the_mask_does_not_hide_what_is_over_the_threshold(tmp_path: Path, is_changed: bool) -> None:
    """Round it as its outline or, where the view has changed, beside it as faint smoke."""
    probability = np.full((64, 128), 0.55, np.float32)
    if is_changed:
        probability[8:37, 8:72] = 0.1
    probability[10:20, 10:20] = probability[30:35, 60:70] = 0.7
    card = {"faint_threshold": "0.5"} if is_changed else {"outline_threshold": "0.5"}
    change = np.full((64, 128), 50.0, np.float32) if is_changed else None
    mask = segmenter(tmp_path, **card).mask(probability, 0.65, change)
    assert np.array_equal(mask > 0, probability > 0.65)


def test_it_is_a_share(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"distloc\.outline_threshold"):
        segmenter(tmp_path, outline_threshold="5")
