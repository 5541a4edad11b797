"""The way from the CPU to a GPU and back, with the real process and providers that are pretended at ONNX Runtime."""

import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.common.messages import Frame
from service.config.sections import Config, PreprocessingConfig, SegmenterConfig, ZenohConfig
from service.flight.app import App
from service.segmenters.accelerator.accelerator import Accelerator
from service.segmenters.accelerator.protocol import Plan
from service.segmenters.accelerator.worker import tuning_of
from service.segmenters.model_session import ModelError
from service.segmenters.onnx import OnnxSegmenter, difference, disagreement
from service.segmenters.segment import make_accelerator, make_segmenter
from tests.support.gpu_onnxruntime import ALL, CPU, CUDA, TENSORRT, pretend
from tests.support.onnx_models import CARD, FREE, red_model
from tests.support.places import HANG_S, ROOT

CAMERA = Camera(128, 64, 100.0, 100.0, 64.0, 32.0)
Make = Callable[..., OnnxSegmenter]


@pytest.fixture(autouse=True)
def no_state(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    """A segmenter of the tiny model that sees red, with its accelerator started; all are closed at the end."""
    made: list[OnnxSegmenter] = []

    def made_of(
        *, retries_s: tuple[float, ...] = (), shape: tuple[int | str, ...] = FREE, **settings: object
    ) -> OnnxSegmenter:
        path = red_model(tmp_path / "red.onnx", CARD, shape)
        config = SegmenterConfig(kind="onnx", model=str(path), **settings)  # type: ignore[arg-type]
        accelerator = Accelerator(retries_s=retries_s)
        segmenter = make_segmenter(config, CAMERA, accelerator=accelerator)
        assert isinstance(segmenter, OnnxSegmenter)
        made.append(segmenter)
        accelerator.start()
        return segmenter

    yield made_of
    for one in made:
        one.accelerator.close()


def picture(seed: int = 0) -> NDArray[np.uint8]:
    image = np.random.default_rng(seed).integers(0, 90, (64, 128, 3)).astype(np.uint8)
    image[20:40, 30:60] = (0, 0, 255)
    return image


def told(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def wait_until(condition: Callable[[], object]) -> None:
    end_s = time.monotonic() + HANG_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_it_sees_on_the_cpu_until_the_gpu_is_ready_and_proved(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ort").mkdir()
    building = tmp_path / "ort" / "building"
    building.touch()
    asked = pretend(monkeypatch, tmp_path / "ort", **{TENSORRT: {"while": "building"}})
    segmenter, image = make(), picture()
    wait_until(asked.opened)
    own = segmenter.probability(image)
    assert segmenter.name == "onnx red on CPU" and segmenter.accelerator.state.state == "preparing"
    building.unlink()
    segmenter.accelerator.settle()
    assert segmenter.accelerator.state.state == "proving" and segmenter.name == "onnx red on CPU"
    np.testing.assert_array_equal(segmenter.probability(image), own)
    assert segmenter.accelerator.state.state == "used" and segmenter.name == "onnx red on Tensorrt"
    np.testing.assert_array_equal(segmenter.probability(image), own)
    (opened,) = asked.opened()
    assert opened["pid"] != os.getpid() and list(opened["asked"]) == list(ALL)


def test_the_inputs_sizes_are_fixed_for_it(tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = pretend(monkeypatch, tmp_path / "ort")
    segmenter = make()
    segmenter.settle(picture())
    options = asked.opened()[0]["asked"][TENSORRT]
    assert {options[f"trt_profile_{key}_shapes"] for key in ("min", "max", "opt")} == {"x0:1x3x32x64"}
    assert options["trt_fp16_enable"] == "False" and "trt_engine_cache_enable" not in options
    plan = Plan("m", "", ALL, "x", ("y",), ((1, 3, 32, 64), (1, 3, 64, 32)), fp16=True)
    tuning = tuning_of(plan, tmp_path, "")
    assert tuning.options[TENSORRT]["trt_profile_max_shapes"] == "x:1x3x64x64"
    assert tuning.options[TENSORRT]["trt_fp16_enable"] == tuning.options[TENSORRT]["trt_engine_cache_enable"] == "True"
    assert tuning_of(Plan("m", "", (CUDA, CPU), "x", ("y",), ((1, 3, 2, 2),)), None, "").options == {}


def test_a_frame_of_another_size_is_the_cpus(tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort")
    segmenter, tall = make(preprocessing=PreprocessingConfig(resize="budget")), np.zeros((192, 64, 3), np.uint8)
    segmenter.accelerator.settle()
    segmenter.probability(tall)
    assert segmenter.accelerator.state.state == "proving"
    segmenter.settle(picture())
    segmenter.probability(tall)
    assert segmenter.accelerator.run(np.zeros((1, 3, 96, 32), np.float32)) is None
    assert segmenter.accelerator.state.state == "used"


@pytest.mark.parametrize("fault", ["opening", "running"])
def test_one_that_fails_leaves_it_to_the_next_and_says_so_in_a_line(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, fault: str
) -> None:
    pretend(monkeypatch, tmp_path / "ort", **{TENSORRT: {fault: "no kernel image\nis available"}})
    segmenter = make()
    segmenter.settle(picture())
    assert segmenter.name == "onnx red on CUDA"
    (line,) = told(caplog)
    failed = "the model failed: " if fault == "running" else ""
    assert line == f"Tensorrt is not used: {failed}no kernel image; the segmenter runs on the CPU"


def test_where_all_fail_the_cpu_goes_on(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    asked = pretend(monkeypatch, tmp_path / "ort", lacking=[TENSORRT, CUDA])
    segmenter = make()
    segmenter.settle(picture())
    assert segmenter.name == "onnx red on CPU" and segmenter.accelerator.state.state == "failed"
    mask = segmenter.segment(Frame(0, "a", picture()), None)
    assert isinstance(mask, np.ndarray) and mask.any()
    assert segmenter.accelerator.state.refused == dict.fromkeys(
        ("Tensorrt", "CUDA"), "it needs libcublas.so.13, which is not installed"
    )
    assert len(told(caplog)) == 2 and len(asked.opened()) == 2
    wait_until(lambda: not any(is_alive(one["pid"]) for one in asked.opened()))


def test_what_onnx_runtime_passes_over_silently_is_told(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pretend(monkeypatch, tmp_path / "ort", lacking=[TENSORRT])
    segmenter = make()
    segmenter.settle(picture())
    assert segmenter.name == "onnx red on CUDA"
    (line,) = told(caplog)
    assert line.startswith("Tensorrt is not used: ONNX Runtime could not load it")


@pytest.mark.parametrize(
    ("how", "words"),
    [({"kills": True}, "SIGSEGV"), ({"running": "device lost"}, "device lost"), ({"hangs_at": 6}, "no answer within")],
)
def test_one_that_fails_in_flight_costs_no_frame_and_is_tried_again(
    tmp_path: Path,
    make: Make,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    how: dict[str, object],
    words: str,
) -> None:
    asked = pretend(monkeypatch, tmp_path / "ort", (TENSORRT, CPU), **{TENSORRT: {"from_run": 6, **how}})
    segmenter, image = make(retries_s=(0.01,)), picture()
    segmenter.settle(image)  # two runs at the start, two to prove it
    own = segmenter.own_probability(image)
    np.testing.assert_array_equal(segmenter.probability(image), own)
    assert segmenter.name == "onnx red on Tensorrt"
    with monkeypatch.context() as limited:
        if "hangs_at" in how:
            limited.setattr("service.segmenters.accelerator.process.RUN_LIMIT_S", 0.2)
        np.testing.assert_array_equal(segmenter.probability(image), own)
    assert segmenter.name == "onnx red on CPU"
    (line,) = told(caplog)
    assert line.startswith("Tensorrt failed: ") and words in line
    wait_until(lambda: len(asked.opened()) == 2)
    assert not is_alive(asked.opened()[0]["pid"])
    segmenter.settle(image)
    assert segmenter.name == "onnx red on Tensorrt"


@pytest.mark.parametrize("wrong", [{"adds": 30.0}, {"adds": float("nan")}, {"times": 0.0}, {"times": -1.0}])
def test_one_that_computes_something_else_than_the_cpu_is_not_used(
    tmp_path: Path,
    make: Make,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    wrong: dict[str, float],
) -> None:
    pretend(monkeypatch, tmp_path / "ort", **{TENSORRT: wrong})
    segmenter, without_smoke = make(), np.zeros((64, 128, 3), np.uint8)
    segmenter.settle(without_smoke)
    assert segmenter.name == "onnx red on CUDA"
    assert told(caplog)[0].startswith("Tensorrt is not used: on noise its output is ")


@pytest.mark.parametrize("wrong", [{"adds": 30.0}, {"times": 0.0}])
def test_one_that_is_not_proved_touches_no_frame_of_any_size(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch, wrong: dict[str, float]
) -> None:
    """A source may give whole fractions of the camera's size: the model's input is the same."""
    pretend(monkeypatch, tmp_path / "ort", (CUDA, CPU), **{CUDA: wrong})
    segmenter, half = make(), picture()[::2, ::2].copy()
    segmenter.accelerator.settle()
    own = segmenter.own_probability(half)
    for _ in range(3):
        np.testing.assert_array_equal(segmenter.probability(half), own)
    assert segmenter.name == "onnx red on CPU" and "on noise" in segmenter.accelerator.state.refused["CUDA"]


def test_a_frame_of_a_fraction_of_the_size_proves_it(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(monkeypatch, tmp_path / "ort")
    segmenter, half = make(), picture()[::2, ::2].copy()
    segmenter.accelerator.settle()
    own = segmenter.probability(half)
    assert segmenter.name == "onnx red on Tensorrt"
    np.testing.assert_array_equal(segmenter.probability(half), own)


def test_it_is_proved_for_a_command_whatever_picture_it_brings(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(monkeypatch, tmp_path / "ort")
    segmenter = make(preprocessing=PreprocessingConfig(resize="budget"))
    segmenter.settle(np.zeros((192, 64, 3), np.uint8))
    assert segmenter.accelerator.state.state == "used"


@pytest.mark.parametrize("wrong", [{"adds": float("nan")}, {"each": 2}])
def test_what_can_be_no_output_costs_no_frame_and_it_is_tried_again(
    tmp_path: Path,
    make: Make,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    wrong: dict[str, float],
) -> None:
    asked = pretend(monkeypatch, tmp_path / "ort", (TENSORRT, CPU), **{TENSORRT: {"from_run": 6, **wrong}})
    segmenter, image = make(retries_s=(0.01,)), picture()
    segmenter.settle(image)
    masks = [segmenter.segment(Frame(number, "a", image), None) for number in range(2)]
    assert all(isinstance(mask, np.ndarray) and mask.any() for mask in masks)
    (line,) = told(caplog)
    assert line.startswith("Tensorrt failed: ") and ("finite" in line or "1 x 2 x 32 x 32" in line)
    wait_until(lambda: len(asked.opened()) == 2)
    segmenter.settle(image)
    assert segmenter.name == "onnx red on Tensorrt"


def test_a_model_that_fails_on_the_cpu_as_well_is_not_the_gpus_fault(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pretend(monkeypatch, tmp_path / "ort", (TENSORRT, CPU))
    segmenter = make()
    segmenter.settle(picture())

    def refused(*_: object) -> None:
        raise ModelError("no numbers")

    monkeypatch.setattr("service.segmenters.onnx.add_probability", refused)
    assert segmenter.segment(Frame(0, "a", picture()), None) is RejectReason.SEGMENTATION_FAILED
    assert segmenter.name == "onnx red on Tensorrt" and told(caplog) == []


def test_one_that_sees_nothing_any_more_is_noticed_without_smoke(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("service.segmenters.onnx.PROVED_EACH", 5)
    pretend(monkeypatch, tmp_path / "ort", (TENSORRT, CPU), **{TENSORRT: {"from_run": 9, "times": 0.0}})
    segmenter, without_smoke = make(), np.zeros((64, 128, 3), np.uint8)
    segmenter.settle(without_smoke)  # its first 4 runs; then 4 frames, and noise
    names = [(segmenter.probability(without_smoke), segmenter.name)[1] for _ in range(5)]
    assert names[:4] == ["onnx red on Tensorrt"] * 4 and names[4] == "onnx red on CPU"
    (line,) = told(caplog)
    assert line.startswith("Tensorrt failed: on noise its output is ")


def test_outputs_agree_but_for_rounding() -> None:
    own = np.random.default_rng(0).normal(0.0, 4.0, (1, 2, 30, 40)).astype(np.float32)
    assert difference(own, own.astype(np.float16).astype(np.float32)) == difference(own, own + 0.01) == ""
    assert "0.5 off" in difference(own, own + 0.5) and difference(own, own[:, :1])
    assert difference(own, np.full_like(own, np.nan)) and difference(own[:0], own[:0]) == ""
    constant = np.full((1, 5, 3), 7.0, np.float32)
    assert difference(constant, constant) == "" and difference(constant, constant + 0.1)


def test_probabilities_agree_but_for_a_few_pixels() -> None:
    own = np.zeros((100, 100), np.float32)
    other = own.copy()
    other[:10, :10] = 1.0
    assert disagreement(own, other) == "" and disagreement(own, own + 0.2) == ""
    other[10, 0] = 1.0
    assert "1.0% of the mask" in disagreement(own, other)
    assert "100.0%" in disagreement(own, np.full_like(own, np.nan))


def test_it_is_closed_while_an_engine_is_built(tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ort").mkdir()
    (tmp_path / "ort" / "building").touch()
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    asked = pretend(monkeypatch, tmp_path / "ort", **{TENSORRT: {"while": "building"}})
    segmenter = make()
    wait_until(asked.opened)
    assert list((tmp_path / "scratch").rglob("*"))
    segmenter.accelerator.close()
    assert not is_alive(asked.opened()[0]["pid"]) and not list((tmp_path / "scratch").iterdir())
    assert segmenter.accelerator.run(np.zeros((1, 3, 32, 64), np.float32)) is None


def test_it_is_closed_while_a_run_hangs(tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.segmenters.accelerator.process.RUN_LIMIT_S", 3600.0)
    pretend(monkeypatch, tmp_path / "ort", (TENSORRT, CPU), **{TENSORRT: {"hangs_at": 5}})
    segmenter, image, given = make(), picture(), []
    segmenter.settle(image)
    assert segmenter.name == "onnx red on Tensorrt"
    flight = threading.Thread(target=lambda: given.append(segmenter.probability(image)))
    flight.start()
    segmenter.accelerator.close()
    flight.join(HANG_S)
    np.testing.assert_array_equal(given[0], segmenter.own_probability(image))


_SERVICE = """
import sys, time
from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.config.sections import SegmenterConfig
from service.segmenters.segment import make_segmenter

segmenter = make_segmenter(SegmenterConfig(kind="onnx", model=sys.argv[1]), Camera(128, 64, 100.0, 100.0, 64.0, 32.0))
print(segmenter.name, flush=True)
time.sleep(3600)
"""


def test_a_service_that_is_killed_leaves_no_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = pretend(monkeypatch, tmp_path / "ort")
    path = red_model(tmp_path / "red.onnx", CARD)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path / 'ort'}:{ROOT}"}
    command = [sys.executable, "-c", _SERVICE, str(path)]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as service:
        assert service.stdout is not None
        name = service.stdout.readline()
        (opened,) = (one for one in asked.opened() if TENSORRT in one["asked"])
        was_alive = is_alive(opened["pid"])
        service.kill()
    assert name == "onnx red on Tensorrt\n" and was_alive
    wait_until(lambda: not is_alive(opened["pid"]))


def test_engines_are_kept_for_the_next_start(
    tmp_path: Path, make: Make, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    asked = pretend(monkeypatch, tmp_path / "ort")
    for _ in range(2):
        segmenter = make()
        segmenter.settle(picture())
        segmenter.accelerator.close()
    assert asked.built() == ["built", "found"] and told(caplog) == []
    (engine,) = (tmp_path / "state" / "engines").glob("*/*.engine")
    engine.write_bytes(engine.read_bytes()[:100])
    segmenter = make()
    segmenter.settle(picture())
    assert segmenter.name == "onnx red on Tensorrt" and asked.built()[-1] == "built"
    (line,) = told(caplog)
    assert str(engine) in line and "cut short" in line


def test_the_status_has_it_and_a_flight_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort")
    path = red_model(tmp_path / "red.onnx", CARD)
    app = App(Config(segmenter=SegmenterConfig(kind="onnx", model=str(path)), zenoh=ZenohConfig(enabled=False)))
    counters = app.counters()
    assert counters["segmenter"] == "onnx red on CPU"
    assert counters["accelerator"]["state"] == "preparing" and counters["accelerator"]["provider"] == TENSORRT


def test_without_a_gpus_provider_there_is_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pretend(monkeypatch, tmp_path / "ort", (CPU,))
    assert make_accelerator(SegmenterConfig(kind="onnx")).state.state == "none"
    pretend(monkeypatch, tmp_path / "ort")
    assert make_accelerator(SegmenterConfig(kind="onnx", providers=(CPU, CUDA))).state.state == "none"
    assert make_accelerator(SegmenterConfig(kind="classical")).state.state == "none"
    assert make_accelerator(SegmenterConfig(kind="onnx")).state.state == "preparing"
