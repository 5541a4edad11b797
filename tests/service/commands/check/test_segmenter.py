"""`distloc check` of what runs the segmenter: two packages, a GPU not used, providers that fail, parts."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from service.commands.check import segmenter as checked
from service.commands.check.segmenter import check_packages, check_segmenter, provider_findings
from service.commands.cli import app
from service.config.sections import CameraConfig, Config, SegmenterConfig
from service.segmenters.accelerator.accelerator import AcceleratorState
from service.segmenters.accelerator.protocol import Part
from tests.support.gpu_onnxruntime import ALL, CPU, CUDA, TENSORRT, pretend
from tests.support.onnx_models import CARD, FREE, red_model

NODE = Path("/dev/nvhost-gpu")


@pytest.fixture(autouse=True)
def no_state(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


@pytest.fixture
def gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checked, "gpu_nodes", lambda: [NODE])


def said(tmp_path: Path, **settings: object) -> list[str]:
    path = red_model(tmp_path / "red.onnx", CARD, FREE)
    segmenting = SegmenterConfig(kind="onnx", model=str(path), **settings)  # type: ignore[arg-type]
    config = Config(camera=CameraConfig(width=128, height=64, hfov_deg=60.0), segmenter=segmenting)
    return [str(finding) for finding in check_segmenter(config)]


def test_without_a_gpu_it_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort", (CPU,))
    assert said(tmp_path) == ["ok    segmenter: onnx red on CPU"]


@pytest.mark.usefixtures("gpu")
def test_a_gpu_that_is_not_used_is_told_with_the_mend(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort", (CPU,))
    (line,) = said(tmp_path)
    assert line.startswith("warn  segmenter: onnx red on CPU, though this computer (") and str(NODE) in line
    assert "; install NVIDIA's build in place of onnxruntime " in line
    pretend(monkeypatch, tmp_path / "ort")
    (line,) = said(tmp_path, providers=(CPU,))
    assert "; name them in segmenter.providers before the CPU's" in line
    monkeypatch.setattr(checked, "gpu_nodes", lambda: [])
    monkeypatch.setattr(checked, "is_jetson", lambda: True)
    pretend(monkeypatch, tmp_path / "ort", (CPU,))
    (line,) = said(tmp_path)
    assert "hand its devices to this container" in line


@pytest.mark.usefixtures("gpu")
def test_a_provider_that_fails_at_the_first_run_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort", (TENSORRT, CPU), **{TENSORRT: {"running": "no kernel image"}})
    begins, fails, runs = said(tmp_path)
    assert begins.startswith("ok    segmenter: Tensorrt is prepared")
    assert fails == (
        "warn  segmenter: Tensorrt is not used: the model failed: no kernel image; the CPU does its work; mend it, or "
        "leave TensorrtExecutionProvider out of segmenter.providers"
    )
    assert runs == "ok    segmenter: onnx red on CPU"


def test_a_library_that_lacks_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort", (CUDA, CPU), lacking=[CUDA])
    (line,) = (line for line in said(tmp_path) if line.startswith("warn"))
    assert (
        "CUDA is not used: it needs libcublas.so.13, which is not installed; this computer shows no NVIDIA GPU" in line
    )
    monkeypatch.setattr(checked, "gpu_nodes", lambda: [NODE])
    (line,) = (line for line in said(tmp_path) if line.startswith("warn"))
    assert "; install the CUDA, cuDNN and TensorRT that this ONNX Runtime was built for" in line


@pytest.mark.usefixtures("gpu")
def test_what_each_provider_got_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort", **{TENSORRT: {"leaves": ["Identity", "FusedConv"]}})
    lines = said(tmp_path, fp16=True)
    (parts,) = (line for line in lines if " parts: " in line)
    assert "Tensorrt" in parts and "% of the time" in parts
    assert lines[-1].startswith("ok    segmenter: onnx red on Tensorrt, ")


def test_much_on_the_cpu_is_a_warning() -> None:
    def of(share: float) -> str:
        parts = (Part(TENSORRT, 3, 2, 1.0 - share), Part(CPU, 9, 2, share, ("Resize",)))
        (finding,) = provider_findings(AcceleratorState("used", TENSORRT, parts=parts))
        return finding.level

    assert of(0.05) == "ok" and of(0.3) == "warn"


def test_what_is_wrong_with_the_engines_kept_is_told_with_the_mend(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pretend(monkeypatch, tmp_path / "ort")
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "file"))
    (line,) = (line for line in said(tmp_path) if line.startswith("warn"))
    assert line == (
        f"warn  engine: no engine can be kept in {tmp_path}/file/engines: Not a directory: it is built at each start; "
        "give the folder, and room on its disk, to the service's user"
    )


def test_two_packages_of_one_module_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert check_packages() == []
    for name, version in (("onnxruntime", "1.22.0"), ("onnxruntime-gpu", "1.23.0")):
        folder = tmp_path / f"{name.replace('-', '_')}-{version}.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        (folder / "top_level.txt").write_text("onnxruntime\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    (finding,) = check_packages()
    line = str(finding)
    assert line.startswith(
        "warn  segmenter: onnxruntime 1.22.0 and onnxruntime-gpu 1.23.0 are both installed, one module"
    )
    assert "; pip uninstall --yes onnxruntime onnxruntime-gpu, then install the one" in line


def test_check_model_says_what_16_bits_cost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort", ALL)
    pixels = np.random.default_rng(0).integers(0, 255, (64, 128, 3)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "image.png"), pixels)
    (tmp_path / "c.toml").write_text(
        "[camera]\nwidth = 128\nheight = 64\nhfov_deg = 60.0\n[segmenter]\nfp16 = true\nflood_share = 1.0\n"
    )
    arguments = ["check", "--model", str(red_model(tmp_path / "red.onnx", CARD)), "--config", str(tmp_path / "c.toml")]
    arguments += ["--image", str(tmp_path / "image.png"), "--out", str(tmp_path / "out.png")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.stdout
    lines = dict(line.split(": ", 1) for line in done.stdout.splitlines())
    assert lines["ok    provider"].startswith(TENSORRT)
    assert lines["ok    accuracy"].startswith("Tensorrt with 16 bits is 0.00")
    assert " rms; " in lines["ok    accuracy"] and "of 2048 pixels of the mask change sides" in lines["ok    accuracy"]


def test_16_bits_without_tensorrt_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, tmp_path / "ort", (CPU,))
    assert said(tmp_path, fp16=True)[-1].startswith("warn  segmenter: segmenter.fp16 is true, and CPU computes with 32")


def test_without_onnx_runtime_the_line_names_what_to_install_and_no_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    (line,) = said(tmp_path)
    assert line.startswith("fail  segmenter: segmenter.kind is 'onnx': ONNX Runtime cannot be loaded")
    assert "install onnxruntime, or take segmenter.kind = 'classical'" in line and "name" not in line
