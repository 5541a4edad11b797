"""Tiny models for the tests: one that sees red, one that says fixed boxes; with any card."""

from pathlib import Path

import numpy as np
import onnx
from numpy.typing import ArrayLike
from onnx import TensorProto, helper

CARD = {
    "input_width": "64", "input_height": "32", "layout": "NCHW", "colour": "RGB", "scale": "0.00392156862745098",
    "mean": "0", "std": "1", "output": "logits", "classes": "background,smoke", "smoke_class": "smoke",
}  # fmt: skip
FREE = ("N", 3, "height", "width")
_ATTRIBUTES: dict[str, dict[str, object]] = {
    "Softmax": {"axis": -3},
    "AveragePool": {"kernel_shape": [8, 8], "strides": [8, 8]},
}


def red_model(
    path: Path,
    card: dict[str, str],
    shape: tuple[int | str, ...] = (1, 3, 32, 64),
    *,
    channels: int = 2,
    kernel: int = 1,
    after: tuple[str, ...] = (),
    is_nhwc: bool = False,
    kind: int = TensorProto.FLOAT,
) -> Path:
    """Smoke's logit is 20 (red - 0.5), red the mean over kernel x kernel pixels; the others' 0. `after` follows it."""
    weights = np.zeros((channels, 3, kernel, kernel), np.float32)
    weights[-1, 0] = 20.0 / kernel**2
    bias = np.zeros(channels, np.float32)
    bias[-1] = -10.0
    steps: list[tuple[str, dict[str, object]]] = [("Transpose", {"perm": [0, 3, 1, 2]})] if is_nhwc else []
    pad = kernel // 2
    steps += [("Cast", {"to": TensorProto.FLOAT}), ("Conv", {"pads": [pad, pad, pad, pad]})]
    steps += [(name, _ATTRIBUTES.get(name, {})) for name in after]
    steps += [("Transpose", {"perm": [0, 2, 3, 1]})] if is_nhwc else []
    nodes = []
    for i, (name, attributes) in enumerate(steps):
        taken = [f"x{i}", "weights", "bias"] if name == "Conv" else [f"x{i}"]
        nodes.append(helper.make_node(name, taken, [f"x{i + 1}"], **attributes))
    nodes.append(helper.make_node("Identity", [f"x{len(steps)}"], ["odd/name:0"]))
    constants = [onnx.numpy_helper.from_array(weights, "weights"), onnx.numpy_helper.from_array(bias, "bias")]
    return _saved(path, card, nodes, ("x0", kind, shape), ["odd/name:0"], constants)


def said_model(path: Path, card: dict[str, str], said: ArrayLike, shape: tuple[int | str, ...]) -> Path:
    """Two outputs whatever it sees: `other`, a single 0, and `said`."""
    constants = [
        onnx.numpy_helper.from_array(np.zeros(1, np.float32), "zero"),
        onnx.numpy_helper.from_array(np.asarray(said, np.float32), "table"),
    ]
    nodes = [helper.make_node("Identity", ["zero"], ["other"]), helper.make_node("Identity", ["table"], ["said"])]
    return _saved(path, card, nodes, ("images", TensorProto.FLOAT, shape), ["other", "said"], constants)


def exported_model(
    path: Path,
    metadata: dict[str, str],
    table: ArrayLike,
    prototypes: ArrayLike | None = None,
    shape: tuple[int | str, ...] = (1, 3, 128, 128),
) -> Path:
    """Says the same boxes whatever it sees, in the outputs' order and under the metadata of YOLO's exporter."""
    said = {"output0": table} | ({} if prototypes is None else {"output1": prototypes})
    constants = [onnx.numpy_helper.from_array(np.asarray(one, np.float32), f"c_{name}") for name, one in said.items()]
    nodes = [helper.make_node("Identity", [f"c_{name}"], [name]) for name in said]
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, np.shape(one)) for name, one in said.items()],
        constants,
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, metadata)
    onnx.save(made, str(path))
    return path


def _saved(path, card, nodes, taken, given, constants) -> Path:  # type: ignore[no-untyped-def]
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info(*taken)],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in given],
        constants,
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(made, {f"distloc.{key}": value for key, value in card.items()})
    onnx.save(made, str(path))
    return path
