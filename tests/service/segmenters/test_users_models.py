"""Models of the exporter of YOLOv8 and 11, by its own metadata: found where they say, or refused in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.common.messages import Frame
from service.config.sections import ConfigError, PreprocessingConfig, SegmenterConfig
from service.segmenters.exporter_card import exporter_keys
from service.segmenters.model_session import ModelSession
from service.segmenters.onnx import OnnxSegmenter
from tests.support.onnx_models import CARD, exported_model, said_model

CPU = ("CPUExecutionProvider",)
SIZE = (256, 128)  # of the frame: letterboxed into 128 x 128 it is halved, with 32 pixels of padding above
# As version 8.4 writes it.
METADATA = {
    "description": "Ultralytics YOLO11n model ", "author": "Ultralytics", "version": "8.4.190", "stride": "32",
    "task": "detect", "batch": "1", "imgsz": "[128, 128]", "names": "{0: 'fire', 1: 'smoke'}", "channels": "3",
    "args": "{'data': None, 'batch': 1, 'nms': None, 'dynamic': False, 'simplify': True}", "end2end": "False",
}  # fmt: skip
NMS = {"args": "{'batch': 1, 'nms': True}"}
BOX = [48.0, 56.0, 32.0, 16.0]  # centre and size in the input: (64, 32, 128, 64) in the frame
CORNERS = [32.0, 48.0, 64.0, 64.0]
NOTHING = [60.0, 60.0, 20.0, 20.0, 0.0, 0.0]


def opened(path: Path, **settings: Any) -> OnnxSegmenter:
    camera = Camera(*SIZE, 200.0, 200.0, 128.0, 64.0)
    config = SegmenterConfig(kind="onnx", model=str(path), providers=CPU, **settings)
    return OnnxSegmenter(ModelSession(path, config.providers), camera, config)


def seen(segmenter: OnnxSegmenter) -> NDArray[np.bool_]:
    mask = segmenter.segment(Frame(0, "a", np.zeros((SIZE[1], SIZE[0], 3), np.uint8)), None)
    assert not isinstance(mask, RejectReason), mask
    return mask > 0


def where(rows: slice, columns: slice) -> NDArray[np.bool_]:
    mask = np.zeros((64, 128), np.bool_)
    mask[rows, columns] = True
    return mask


BOXED = where(slice(16, 32), slice(32, 64))


def of_shares(box: list[float]) -> list[float]:
    return [value / 128.0 for value in box]


@pytest.mark.parametrize(
    ("metadata", "rows", "is_across"),
    [
        ({}, [[*BOX, 0.1, 0.6], [*BOX, 0.9, 0.1]], True),
        ({"names": "{0: \"a fire's\", 1: 'Smoke'}"}, [[*BOX, 0.1, 0.6]], True),
        (NMS, [[*CORNERS, 0.6, 1], [*CORNERS, 0.9, 0], [0.0] * 6], False),
        ({"end2end": "True"}, [[*CORNERS, 0.6, 1]], False),
        ({}, [[*of_shares(BOX), 0.1, 0.6]], True),
        (NMS, [[*of_shares(CORNERS), 0.6, 1], [0.0] * 6], False),
    ],
    ids=["raw", "names in quotes", "own suppression", "end to end", "raw, 0 to 1", "suppressed, 0 to 1"],
)
def test_a_detector_needs_no_card(
    tmp_path: Path, metadata: dict[str, str], rows: list[list[float]], is_across: bool
) -> None:
    filler = [[of * (1.0 if max(rows[0][:4]) > 2 else 1 / 128.0) for of in NOTHING[:4]] + [0.0, 0.0]] * 20
    table = np.array(rows + filler)[None] if is_across else np.array(rows)[None]
    path = exported_model(tmp_path / "a.onnx", METADATA | metadata, table.transpose(0, 2, 1) if is_across else table)
    segmenter = opened(path)
    assert np.array_equal(seen(segmenter), BOXED)
    assert segmenter.threshold == 0.25 and segmenter.card.resize == "letterbox"


@pytest.mark.parametrize("is_suppressed", [False, True])
def test_a_segmenters_masks_are_drawn_inside_their_boxes(tmp_path: Path, is_suppressed: bool) -> None:
    prototypes = np.zeros((1, 4, 32, 32))  # a quarter of the input's size
    prototypes[0, 1] = -1.0
    prototypes[0, 1, :, 8:12] = 1.0  # the input's columns 32 to 48, and the frame's 64 to 96
    weights = [0.0, 1.0, 0.0, 0.0]
    row = [*CORNERS, 0.6, 1, *weights] if is_suppressed else [*BOX, 0.0, 0.6, *weights]
    table = np.array([row, *([[*NOTHING, *weights]] * 20)])[None]
    metadata = METADATA | {"task": "segment"} | (NMS if is_suppressed else {})
    made = exported_model(
        tmp_path / "a.onnx", metadata, table if is_suppressed else table.transpose(0, 2, 1), prototypes
    )
    assert np.array_equal(seen(opened(made)), where(slice(16, 32), slice(32, 48)))


def test_planes_beside_boxes_without_weights_are_left_alone(tmp_path: Path) -> None:
    table = np.array([[*BOX, 0.1, 0.6], *[NOTHING] * 20])[None].transpose(0, 2, 1)
    assert np.array_equal(
        seen(opened(exported_model(tmp_path / "a.onnx", METADATA, table, np.ones((1, 32, 4, 4))))), BOXED
    )


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"task": "obb"}, "the task 'obb', which gives boxes that are turned: train and export a model for detect"),
        ({"task": "pose"}, "the task 'pose'"),
        ({"task": "classify"}, "says whether there is smoke, not where"),
        ({"task": "a\x1bnew one"}, "is none that is known"),
        ({"names": "{0: 'cat', 1: 'dog'}"}, r"lacks distloc.smoke_class; .*\(its classes are 'cat, dog'\)"),
        ({"names": "{0: 'smoke', 1: 'Smoke'}"}, "lacks distloc.smoke_class"),
        ({"imgsz": "[64, 128]"}, "1 x 3 x 128 x 128: by its metadata it is 1 x 3 x 64 x 128"),
        ({"imgsz": "large"}, "lacks distloc.input_width, distloc.input_height"),
        ({"names": "{0: 'fire', 2: 'smoke'}"}, "lacks distloc.classes, distloc.smoke_class"),
        ({"names": "{0: 'smoke'}"}, r"1 x 6 x 21: yolov8 with 1 classes has 5"),
    ],
)
def test_what_cannot_be_used_is_one_line(tmp_path: Path, metadata: dict[str, str], words: str) -> None:
    path = exported_model(tmp_path / "a.onnx", METADATA | metadata, np.zeros((1, 6, 21)))
    with pytest.raises(ConfigError, match=words) as refused:
        opened(path)
    assert "\n" not in str(refused.value) and "\x1b" not in str(refused.value)


def test_the_config_and_our_own_keys_win_over_the_exporters(tmp_path: Path) -> None:
    table = np.array([[*BOX, 0.1, 0.6], *[NOTHING] * 20])[None].transpose(0, 2, 1)
    metadata = METADATA | {"names": "{0: 'cat', 1: 'haze'}"}
    mine = {"distloc.smoke_class": "haze", "distloc.threshold": "0.7"}
    assert not seen(opened(exported_model(tmp_path / "a.onnx", metadata | mine, table))).any()
    given = PreprocessingConfig(smoke_class="haze", threshold=0.5)
    assert np.array_equal(
        seen(opened(exported_model(tmp_path / "b.onnx", metadata, table), preprocessing=given)), BOXED
    )


def test_another_makers_metadata_says_nothing() -> None:
    assert exporter_keys({"task": "detect", "names": "{0: 'smoke'}"}) == {} == exporter_keys({})


def test_turned_boxes_by_the_shape_alone_are_refused(tmp_path: Path) -> None:
    card = CARD | {
        "input_width": "128", "input_height": "128", "output": "boxes", "classes": "fire,smoke", "output_name": "said",
    }  # fmt: skip
    with pytest.raises(ConfigError, match=r"1 x 7 x 2100: no boxes of 2 classes: export a model that detects"):
        opened(said_model(tmp_path / "a.onnx", card, np.zeros((1, 7, 2100)), (1, 3, 128, 128)))


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.tflite", b"\x1c\0\0\0TFL3rest", "a TFLite model"),
        ("named_wrong.onnx", b"\x1c\0\0\0TFL3rest", "a TFLite model"),
        ("best.pt", b"PK\x03\x04rest", "a PyTorch checkpoint"),
        ("old.pth", b"\x80\x02rest", "a PyTorch checkpoint"),
        ("a.h5", b"\x89HDF\r\n", "a Keras model"),
        ("a.engine", b"ftrt", "a TensorRT engine"),
        ("a.xml", b"<?xml version", "an OpenVINO model"),
    ],
)
def test_other_kinds_of_model_are_named(tmp_path: Path, name: str, content: bytes, kind: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ConfigError, match=rf"{name}': {kind}.*; only ONNX is run: export the model anew") as refused:
        opened(tmp_path / name)
    assert "\n" not in str(refused.value)
