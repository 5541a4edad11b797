"""From the fitted network to the file that the service loads, and what the service makes of it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import torch

from card import OUTLINE_THRESHOLD
from distloc.geometry.camera import Camera
from distloc.study.segmentation import ImageScore, score_image
from distloc.types import RejectReason
from network import SmokeNet
from real import RealFrame
from service.config.sections import SegmenterConfig
from service.segmenters.classical import is_flooded
from service.segmenters.model_session import ModelSession
from service.segmenters.onnx import OnnxSegmenter

INPUT_W, INPUT_H, MULTIPLE = 768, 432, 32
FAINT_THRESHOLD = 0.4  # of what has changed
THRESHOLDS = (0.4, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 0.98)


def export_onnx(net: SmokeNet, path: Path, version: str, threshold: float = THRESHOLDS[0]) -> None:
    """Write the model with the metadata by which the service prepares its input (models/README.md)."""
    net = net.cpu().eval()
    example = torch.zeros(1, 3, 416, INPUT_W)
    sizes = {"image": {2: "height", 3: "width"}, "smoke": {2: "half_height", 3: "half_width"}}
    names = {"input_names": ["image"], "output_names": ["smoke"]}
    torch.onnx.export(net, (example,), str(path), dynamo=False, opset_version=17, dynamic_axes=sizes, **names)
    model = onnx.load(str(path))
    values = {
        "input_width": INPUT_W,
        "input_height": INPUT_H,
        "resize": "budget",
        "multiple": MULTIPLE,
        "layout": "NCHW",
        "colour": "RGB",
        "scale": 1.0 / 255.0,
        "mean": 0,
        "std": 1,
        "output": "logits",
        "classes": "smoke",
        "smoke_class": "smoke",
        "threshold": threshold,
        "outline_threshold": OUTLINE_THRESHOLD,
        "faint_threshold": min(FAINT_THRESHOLD, threshold),
        "version": version,
    }
    onnx.helper.set_model_props(model, {f"distloc.{key}": str(value) for key, value in values.items()})
    split_joins(model)
    onnx.checker.check_model(model, full_check=True)
    onnx.save(model, str(path))


def split_joins(model: onnx.ModelProto) -> None:
    """Have each convolution of two joined tensors be the sum of one of each: the same numbers in less memory and time.

    A join is a copy of both, the largest that a run has, and ONNX Runtime lays it out anew for the convolution.
    """
    graph = onnx.shape_inference.infer_shapes(model).graph
    shapes = {value.name: value.type.tensor_type.shape.dim for value in graph.value_info}
    weights = {one.name: one for one in model.graph.initializer}
    for join in [node for node in model.graph.node if node.op_type == "Concat" and len(node.input) == 2]:
        (conv,) = [node for node in model.graph.node if join.output[0] in node.input]
        assert conv.op_type == "Conv" and conv.input[0] == join.output[0]
        kernel = onnx.numpy_helper.to_array(weights[conv.input[1]])
        kernels = np.split(kernel, [shapes[join.input[0]][1].dim_value], axis=1)
        attributes = {one.name: onnx.helper.get_attribute_value(one) for one in conv.attribute}
        parts = []
        for number, (name, part) in enumerate(zip(join.input, kernels, strict=True)):
            part_name = f"{conv.input[1]}_{number}"
            model.graph.initializer.append(onnx.numpy_helper.from_array(np.ascontiguousarray(part), part_name))
            inputs = [name, part_name, conv.input[2]][: 3 - number]  # the bias once
            parts.append(onnx.helper.make_node("Conv", inputs, [f"{conv.output[0]}_{number}"], **attributes))
        total = onnx.helper.make_node("Add", [part.output[0] for part in parts], [conv.output[0]])
        at = list(model.graph.node).index(conv)
        for node in (total, *parts):
            model.graph.node.insert(at, node)
        model.graph.initializer.remove(weights[conv.input[1]])
        model.graph.node.remove(conv)
        model.graph.node.remove(join)


def service_scores(
    path: Path, frames: Sequence[RealFrame], thresholds: Sequence[float] = THRESHOLDS
) -> dict[float, list[ImageScore]]:
    """By the threshold each frame's score, as the service runs the model."""
    segmenters: dict[tuple[int, int], tuple[Camera, OnnxSegmenter]] = {}
    scores: dict[float, list[ImageScore]] = {threshold: [] for threshold in thresholds}
    for one in frames:
        height, width = one.labelled.image.shape[:2]
        if (width, height) not in segmenters:
            camera = Camera(width, height, float(width), float(width), (width - 1) / 2.0, (height - 1) / 2.0)
            config = SegmenterConfig(kind="onnx", model=str(path))
            session = ModelSession(path, config.providers, config.sha256)
            segmenters[width, height] = camera, OnnxSegmenter(session, camera, config)
        camera, segmenter = segmenters[width, height]
        probability = segmenter.probability(one.labelled.image)
        for threshold, found in scores.items():
            mask = segmenter.mask(probability, threshold, None)
            kept = RejectReason.SEGMENTATION_FLOODED if is_flooded(mask, SegmenterConfig().flood_share) else mask
            found.append(score_image(kept, one.labelled.truth, camera))
    return scores
