from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from distloc.camera import Camera
from distloc.types import RejectReason
from service.config import ConfigError
from service.messages import Frame
from service.segment_onnx import OnnxSegmenter

CAMERA = Camera(128, 64, 100.0, 100.0, 64.0, 32.0)
CARD = {
    "input_width": "64", "input_height": "32", "layout": "NCHW", "colour": "RGB", "scale": "0.00392156862745098",
    "mean": "0", "std": "1", "output": "logits", "classes": "background,smoke", "smoke_class": "smoke", "version": "t1",
}  # fmt: skip


def model(path: Path, card: dict[str, str]) -> Path:
    """Smoke is where red is above one half: a 1 x 1 convolution with logits 0 and 20 (red - 0.5)."""
    weights = np.zeros((2, 3, 1, 1), np.float32)
    weights[1, 0] = 20.0
    graph = helper.make_graph(
        [helper.make_node("Conv", ["x", "w", "b"], ["y"])],
        "red",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, 32, 64])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 2, 32, 64])],
        [onnx.numpy_helper.from_array(weights, "w"), onnx.numpy_helper.from_array(np.float32([0, -10]), "b")],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, {f"distloc.{key}": value for key, value in card.items()})
    onnx.save(made, str(path))
    return path


def test_the_mask_is_where_the_model_says(tmp_path: Path) -> None:
    segmenter = OnnxSegmenter(model(tmp_path / "red.onnx", CARD), CAMERA, 0.5, ["CPUExecutionProvider"])
    image = np.zeros((64, 128, 3), np.uint8)
    image[:, :40] = (255, 0, 0)  # blue must not count: the model wants RGB
    image[10:30, 80:100] = (0, 0, 255)
    mask = segmenter.segment(Frame(0, "a", image), None)
    assert not isinstance(mask, RejectReason) and mask.shape == (32, 64)
    expected = np.zeros((32, 64), np.uint8)
    expected[5:15, 40:50] = 255
    assert np.array_equal(mask, expected)
    assert segmenter.provider == "CPUExecutionProvider" and "t1" in segmenter.name
    assert segmenter.segment(Frame(0, "a", None), None) is RejectReason.BAD_FRAME


@pytest.mark.parametrize("key", sorted(CARD))
def test_a_model_that_lacks_a_key_is_refused_by_name(tmp_path: Path, key: str) -> None:
    path = model(tmp_path / "red.onnx", {name: value for name, value in CARD.items() if name != key})
    with pytest.raises(ConfigError, match=f"distloc.{key}"):
        OnnxSegmenter(path, CAMERA, 0.5)


@pytest.mark.parametrize("wrong", [{"layout": "HWC"}, {"input_width": "48"}, {"smoke_class": "fire"}, {"std": "0"}])
def test_wrong_metadata_is_refused(tmp_path: Path, wrong: dict[str, str]) -> None:
    with pytest.raises(ConfigError, match=r"segmenter\.model"):
        OnnxSegmenter(model(tmp_path / "red.onnx", CARD | wrong), CAMERA, 0.5)


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(b"no model")
    for name in ("a.onnx", "missing.onnx"):
        with pytest.raises(ConfigError, match=name):
            OnnxSegmenter(tmp_path / name, CAMERA, 0.5)
