"""Users' models: every kind of input and output, where what they see lands in the mask, and which are refused."""

import logging
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import onnxruntime
import pytest
from numpy.typing import NDArray
from onnx import TensorProto

from distloc.backports import tomllib
from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.common.messages import Frame
from service.config.load import check
from service.config.sections import Config, ConfigError, PreprocessingConfig, SegmenterConfig, ZenohConfig
from service.flight.app import App
from service.segmenters.model_session import ModelSession
from service.segmenters.onnx import OnnxSegmenter
from service.segmenters.segment import make_segmenter, shipped_model
from service.simulator.scenario import load_scenario, service_config_toml
from tests.support.onnx_models import CARD, FREE, red_model, said_model

CAMERA = Camera(128, 64, 100.0, 100.0, 64.0, 32.0)
CPU = ("CPUExecutionProvider",)
RED = (0, 0, 255)


def opened(path: Path, camera: Camera = CAMERA, **settings: Any) -> OnnxSegmenter:
    config = SegmenterConfig(kind="onnx", model=str(path), providers=CPU, **settings)
    return OnnxSegmenter(ModelSession(path, config.providers), camera, config)


def seen(segmenter: OnnxSegmenter, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    mask = segmenter.segment(Frame(0, "a", image), None)
    assert not isinstance(mask, RejectReason), mask
    assert mask.dtype == np.uint8 and set(np.unique(mask)) <= {0, 255}
    return mask


def camera(width: int, height: int) -> Camera:
    return Camera(width, height, 100.0, 100.0, width / 2.0, height / 2.0)


def scene(width: int, height: int, left: int, top: int, right: int, bottom: int) -> NDArray[np.uint8]:
    """Black with a red rectangle, and blue, which must not count, at the left edge."""
    image = np.zeros((height, width, 3), np.uint8)
    image[:, :8] = (255, 0, 0)
    image[top:bottom, left:right] = RED
    return image


def edges(mask: NDArray[np.uint8], scale: float) -> list[float]:
    """Left, top, right, bottom of what is in the mask, in the camera's pixels."""
    rows, columns = np.nonzero(mask)
    return [columns.min() * scale, rows.min() * scale, (columns.max() + 1) * scale, (rows.max() + 1) * scale]


PROBABILITY = {"output": "probability"}
ONE = {"classes": "smoke"}
SEGMENTATIONS: list[tuple[dict[str, str], dict[str, Any]]] = [
    ({}, {}),
    ({"version": "t1"}, {"shape": FREE}),
    ({}, {"shape": ("N", 3, -1, -1)}),
    (PROBABILITY, {"after": ("Softmax",)}),
    ({"classes": "fire,cloud,smoke"}, {"channels": 3}),
    (ONE, {"channels": 1}),
    (ONE | PROBABILITY, {"channels": 1, "after": ("Sigmoid",)}),
    ({"layout": "NHWC"}, {"is_nhwc": True, "shape": (1, 32, 64, 3)}),
    ({"layout": "NHWC"} | ONE, {"is_nhwc": True, "shape": (1, 32, 64, 3), "channels": 1}),
    ({"layout": "NCHW", "output_name": "odd/name:0", "output_layout": "NCHW"}, {}),
    ({}, {"kind": TensorProto.FLOAT16}),
]


@pytest.mark.parametrize(("card", "made"), SEGMENTATIONS)
def test_the_mask_is_where_the_model_says(tmp_path: Path, card: dict[str, str], made: dict[str, Any]) -> None:
    segmenter = opened(red_model(tmp_path / "red.onnx", CARD | card, **made))
    mask = seen(segmenter, scene(128, 64, 80, 10, 100, 30))
    expected = np.zeros((32, 64), np.uint8)
    expected[5:15, 40:50] = 255
    assert np.array_equal(mask, expected)
    assert segmenter.provider == "CPUExecutionProvider"
    assert segmenter.name == f"onnx red{' t1' if 'version' in card else ''} on CPU"
    assert segmenter.segment(Frame(0, "a", None), None) is RejectReason.BAD_FRAME


def test_a_single_map_without_channels_is_one_channel(tmp_path: Path) -> None:
    said = np.zeros((1, 4, 8))
    said[0, 1, 2] = 0.9
    card = CARD | ONE | PROBABILITY | {"output_name": "said"}
    mask = seen(opened(said_model(tmp_path / "a.onnx", card, said, (1, 3, 32, 64))), scene(128, 64, 0, 0, 0, 0))
    middle = np.array(edges(mask, 2.0)).reshape(2, 2).mean(axis=0)
    assert middle == pytest.approx([(2 + 0.5) * 16, (1 + 0.5) * 16], abs=1.0)


@pytest.mark.parametrize("size", [(256, 96), (250, 100), (90, 200), (131, 64)])
def test_letterbox_is_undone(tmp_path: Path, size: tuple[int, int]) -> None:
    card = CARD | {"input_width": "128", "input_height": "128", "resize": "letterbox"}
    segmenter = opened(red_model(tmp_path / "red.onnx", card, (1, 3, 128, 128)), camera(*size))
    wanted = [40, 30, 64, 54]
    mask = seen(segmenter, scene(*size, *wanted))
    assert edges(mask, size[0] / mask.shape[1]) == pytest.approx(wanted, abs=2.0)


def test_a_coarse_output_keeps_its_place(tmp_path: Path) -> None:
    """PIDNet's logits have an eighth of the input's size."""
    card = CARD | {"input_width": "256", "input_height": "256", "resize": "letterbox"}
    path = red_model(tmp_path / "red.onnx", card, (1, 3, 256, 256), after=("AveragePool",))
    mask = seen(opened(path, camera(512, 288)), scene(512, 288, 208, 112, 272, 176))
    assert mask.shape == (144, 256)
    assert edges(mask, 2.0) == pytest.approx([208, 112, 272, 176], abs=8.0)
    middle = np.array(edges(mask, 2.0)).reshape(2, 2).mean(axis=0)
    assert middle == pytest.approx([240, 144], abs=0.5)


@pytest.mark.parametrize(
    ("size", "multiple", "sides"), [((320, 180), 32, (224, 128)), ((100, 60), 8, (96, 56)), ((20, 300), 32, (32, 288))]
)
def test_a_budget_of_pixels(tmp_path: Path, size: tuple[int, int], multiple: int, sides: tuple[int, int]) -> None:
    budget = {"input_width": "160", "input_height": "160", "resize": "budget", "multiple": str(multiple)}
    segmenter = opened(red_model(tmp_path / "red.onnx", CARD | budget, FREE), camera(*size))
    place = segmenter.placements(*size)[0]
    assert (place.across.side, place.down.side) == sides
    mask = seen(segmenter, scene(*size, 10, 30, 18, 50))
    assert edges(mask, size[0] / mask.shape[1]) == pytest.approx([10, 30, 18, 50], abs=2.0)


def test_tiles_find_what_is_small(tmp_path: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD, kernel=3)
    image = scene(256, 128, 150, 71, 156, 77)
    assert not seen(opened(path, camera(256, 128)), image).any()
    for tiles, overlap in ((4, 0.2), (4, 0.0), (5, 0.5)):
        segmenter = opened(path, camera(256, 128), tiles=tiles, tile_overlap=overlap)
        mask = seen(segmenter, image)
        assert len(segmenter.placements(256, 128)) == 1 + tiles**2
        assert edges(mask, 256 / mask.shape[1]) == pytest.approx([150, 71, 156, 77], abs=2.0)


@pytest.mark.parametrize(("side", "tiles", "overlap"), [(1920, 2, 0.2), (1080, 3, 0.5), (101, 4, 0.0), (97, 8, 0.37)])
def test_tiles_cover_the_frame(tmp_path: Path, side: int, tiles: int, overlap: float) -> None:
    places = opened(red_model(tmp_path / "red.onnx", CARD), tiles=tiles, tile_overlap=overlap).placements(side, side)[
        1:
    ]
    spans = sorted({(place.across.start, place.across.start + place.across.length) for place in places})
    assert len(spans) == tiles and spans[0][0] == 0 and spans[-1][1] == side
    shared = [(one[1] - two[0]) / (one[1] - one[0]) for one, two in pairwise(spans)]
    assert shared == pytest.approx([overlap] * (tiles - 1), abs=0.1) and min(shared) >= 0.0


# In a frame of 256 x 128 the boxes (64, 32, 128, 64) and (192, 96, 224, 112); by hand, letterboxed into 128 x 128:
# halved, 32 pixels of padding above.
FOUND = [48.0, 56.0, 32.0, 16.0], [104.0, 84.0, 16.0, 8.0]
ROWS = {
    "yolov8": [[*FOUND[0], 0.1, 0.9], [*FOUND[0], 0.8, 0.2], [50.0, 56.0, 30.0, 16.0, 0.0, 0.7], [*FOUND[1], 0.0, 0.6]],
    "yolov5": [[*FOUND[0], 0.95, 0.1, 0.95], [*FOUND[1], 0.3, 0.1, 0.99], [*FOUND[1], 0.8, 0.0, 0.8]],
    "end-to-end": [
        [32, 48, 64, 64, 0.9, 1],
        [96, 80, 112, 88, 0.6, 1],
        [0, 40, 20, 60, 0.99, 0],
        [0, 0, 0, 0, 0, 0],
    ],
}
BOXES = CARD | {
    "input_width": "128", "input_height": "128", "resize": "letterbox", "output": "boxes",
    "classes": "fire,smoke", "output_name": "said",
}  # fmt: skip


def boxed(path: Path, table: Any, card: dict[str, str], **settings: Any) -> OnnxSegmenter:
    said = said_model(path / "yolo.onnx", BOXES | card, np.float32(table)[None], (1, 3, 128, 128))
    return opened(said, camera(256, 128), **settings)


@pytest.mark.parametrize(
    ("table", "card"),
    [
        (np.transpose(ROWS["yolov8"] + [[0.0] * 6] * 20), {}),
        (ROWS["yolov8"], {"boxes": "yolov8"}),
        (ROWS["yolov5"], {}),
        (ROWS["end-to-end"], {"boxes": "end-to-end"}),
        (ROWS["end-to-end"], {"classes": "fire,smoke,cloud"}),
    ],
)
def test_boxes_become_masks(tmp_path: Path, table: Any, card: dict[str, str]) -> None:
    segmenter = boxed(tmp_path, table, card)
    mask = seen(segmenter, scene(256, 128, 0, 0, 0, 0))
    expected = np.zeros((64, 128), np.uint8)
    expected[16:32, 32:64] = 255
    expected[48:56, 96:112] = 255
    assert np.array_equal(mask, expected)
    assert segmenter.probability(scene(256, 128, 0, 0, 0, 0))[20, 40] == pytest.approx(0.9, abs=0.01)


def test_boxes_outside_and_below_the_threshold_are_left_out(tmp_path: Path) -> None:
    outside = [[64.0, 10.0, 20.0, 20.0, 0.9], [64.0, 120.0, 20.0, 20.0, 0.9], [*FOUND[0], 0.3]]
    segmenter = boxed(tmp_path, outside, {"classes": "smoke"})
    assert not seen(segmenter, scene(256, 128, 0, 0, 0, 0)).any()
    assert seen(boxed(tmp_path, outside, {"classes": "smoke"}, threshold=0.2), scene(256, 128, 0, 0, 0, 0)).any()
    assert seen(boxed(tmp_path, outside, {"classes": "smoke", "threshold": "0.2"}), scene(256, 128, 0, 0, 0, 0)).any()


def test_the_smallest_box_has_a_pixel(tmp_path: Path) -> None:
    mask = seen(boxed(tmp_path, [[48.2, 56.3, 0.1, 0.1, 0.9]], {"classes": "smoke"}), scene(256, 128, 0, 0, 0, 0))
    assert np.argwhere(mask).tolist() == [[24, 48]]


def test_boxes_of_two_possible_kinds_are_asked_about(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"yolov5 or end-to-end: say which by the key boxes"):
        boxed(tmp_path, [[0.0] * 6] * 10, {"classes": "smoke"})
    with pytest.raises(ConfigError, match=r"1 x 3 x 9: no boxes of 1 classes"):
        boxed(tmp_path, [[0.0] * 9] * 3, {"classes": "smoke"})
    with pytest.raises(ConfigError, match=r"yolov5 with 1 classes has 6"):
        boxed(tmp_path, [[0.0] * 9] * 3, {"classes": "smoke", "boxes": "yolov5"})


def test_the_config_wins_over_the_metadata(tmp_path: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD | {"colour": "BGR", "mean": "0.1,0.2,0.3", "threshold": "0.9"})
    right = PreprocessingConfig(colour="RGB", mean=0.0)
    segmenter = opened(path, preprocessing=right, threshold=0.4)
    assert segmenter.threshold == 0.4 and segmenter.card.threshold == 0.9
    assert edges(seen(segmenter, scene(128, 64, 80, 10, 100, 30)), 2.0) == [80, 10, 100, 30]
    assert edges(seen(opened(path), scene(128, 64, 80, 10, 100, 30)), 2.0)[0] == 0


def test_a_model_without_metadata_runs_by_the_config_alone(tmp_path: Path) -> None:
    text = """
    [segmenter.preprocessing]
    input_width = 64
    input_height = 32
    layout = "NCHW"
    colour = "RGB"
    scale = 0.00392156862745098
    mean = [0.0, 0.0, 0.0]
    std = 1
    output = "logits"
    classes = ["background", "smoke"]
    smoke_class = "smoke"
    """
    config = msgspec.convert(tomllib.loads(text), Config)
    segmenter = opened(red_model(tmp_path / "red.onnx", {}), preprocessing=config.segmenter.preprocessing)
    assert edges(seen(segmenter, scene(128, 64, 80, 10, 100, 30)), 2.0) == [80, 10, 100, 30]


@pytest.mark.parametrize("key", sorted(CARD))
def test_a_model_that_lacks_a_key_is_refused_by_name(tmp_path: Path, key: str) -> None:
    path = red_model(tmp_path / "red.onnx", {name: value for name, value in CARD.items() if name != key})
    with pytest.raises(ConfigError, match=f"lacks distloc.{key};"):
        opened(path)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"layout": "HWC"}, r"distloc\.layout is 'HWC'"),
        ({"layout": "NHWC"}, r"1 x 3 x 32 x 64: by its metadata it is 1 x 32 x 64 x 3"),
        ({"input_width": "48"}, r"1 x 3 x 32 x 64: by its metadata it is 1 x 3 x 32 x 48"),
        ({"input_width": "wide"}, r"distloc\.input_width is 'wide'"),
        ({"input_width": "4"}, r"distloc\.input_width is '4'"),
        ({"smoke_class": "fire"}, r"smoke_class is 'fire'"),
        ({"std": "0"}, r"std .* has a 0"),
        ({"mean": "1,2"}, r"mean is .* 1 or 3 finite numbers"),
        ({"mean": "nan"}, r"mean is .* 1 or 3 finite numbers"),
        ({"classes": "smoke,fire,cloud"}, r"output is 1 x 2 x 32 x 64: not 1 or 3 channels"),
        ({"output_name": "heat"}, r"output_name is 'heat': its outputs are odd/name:0"),
        ({"resize": "budget"}, r"by its metadata it is|needs a free height and width"),
        ({"output": "boxes"}, r"not one table of boxes"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(tmp_path: Path, wrong: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=rf"segmenter\.model.*{words}") as told:
        opened(red_model(tmp_path / "red.onnx", CARD | wrong))
    assert "\n" not in str(told.value)


def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.onnx").write_bytes(b"no model")
    for name in ("a.onnx", "missing.onnx"):
        with pytest.raises(ConfigError, match=name):
            opened(tmp_path / name)


def test_numbers_that_are_none_and_a_frame_full_of_smoke_are_failures(tmp_path: Path) -> None:
    broken = opened(red_model(tmp_path / "nan.onnx", CARD, after=("Sqrt",)))  # of the smoke's logit, -10 where black
    assert broken.segment(Frame(0, "a", scene(128, 64, 0, 0, 0, 0)), None) is RejectReason.SEGMENTATION_FAILED
    box = [[np.nan, 56.0, 32.0, 16.0, 0.9]]
    boxes = boxed(tmp_path, box, {"classes": "smoke"})
    assert boxes.segment(Frame(0, "a", scene(256, 128, 0, 0, 0, 0)), None) is RejectReason.SEGMENTATION_FAILED
    flooded = opened(red_model(tmp_path / "red.onnx", CARD), flood_share=0.5)
    image = np.full((64, 128, 3), RED, np.uint8)
    assert flooded.segment(Frame(0, "a", image), None) is RejectReason.SEGMENTATION_FLOODED


def test_a_provider_that_cannot_be_had_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: list(CPU))
    path = red_model(tmp_path / "red.onnx", CARD)
    with caplog.at_level(logging.INFO):
        assert ModelSession(path, ("CUDAExecutionProvider",)).provider == CPU[0]
        assert ModelSession(path, SegmenterConfig().providers).provider == CPU[0]
    assert [record.levelname for record in caplog.records] == ["WARNING"]  # where it is what was asked for, nothing
    assert "CUDAExecutionProvider cannot be had" in caplog.messages[0]


def test_the_status_names_the_model_and_its_provider(tmp_path: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD)
    segmenting = SegmenterConfig(kind="onnx", model=str(path), providers=CPU)
    assert (
        App(Config(segmenter=segmenting, zenoh=ZenohConfig(enabled=False))).counters()["segmenter"] == "onnx red on CPU"
    )


def test_without_a_model_the_shipped_one_is_meant(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert shipped_model().parent.name == "models" and shipped_model().name == "smoke-seg.onnx"
    monkeypatch.setattr("service.segmenters.segment.shipped_model", lambda: red_model(tmp_path / "shipped.onnx", CARD))
    assert make_segmenter(SegmenterConfig(kind="onnx", providers=CPU), CAMERA).name == "onnx shipped on CPU"


def test_a_single_tile_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"segmenter\.tiles is 1"):
        check(Config(segmenter=SegmenterConfig(tiles=1)))


def test_a_config_with_preprocessing_is_written_and_read_again() -> None:
    scenario = load_scenario("demo")
    segmenter = SegmenterConfig(
        kind="onnx", tiles=2, preprocessing=PreprocessingConfig(layout="NHWC", mean=(1.0, 2.0, 3.0))
    )
    text = service_config_toml(scenario, segmenter)
    assert msgspec.convert(tomllib.loads(text), Config).segmenter == segmenter
