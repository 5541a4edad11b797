"""What finds smoke where the config says nothing: the model that ships, or one line that says why it cannot."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from distloc.geometry.camera import Camera
from service.config.sections import Config, ConfigError, SegmenterConfig
from service.segmenters.onnx import OnnxSegmenter
from service.segmenters.segment import make_segmenter, shipped_model
from service.simulator.scenario import Scenario, service_config_toml
from tests.support.places import HANG_S, ROOT

CAMERA = Camera(320, 180, 225.0, 225.0, 159.5, 89.5)


def test_it_is_the_model_that_ships() -> None:
    segmenter = make_segmenter(Config().segmenter, CAMERA)
    assert isinstance(segmenter, OnnxSegmenter) and segmenter.name.startswith(f"onnx {shipped_model().stem} ")
    assert 'kind = "onnx"' in service_config_toml(Scenario())  # what `simulate` and `--write-config` write


def test_without_its_file_one_line_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.segmenters.segment.shipped_model", lambda: tmp_path / "gone.onnx")
    with pytest.raises(ConfigError, match=r"^segmenter\.model is empty: .*gone\.onnx: install .* 'classical'[^\n]*$"):
        make_segmenter(SegmenterConfig(), CAMERA)
    assert make_segmenter(SegmenterConfig(kind="classical"), CAMERA).name == "classical"


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["run", "--config", "config.toml"], 78),
        (["check", "--config", "config.toml", "--seconds", "1"], 1),
        (["check", "--model", str(shipped_model())], 1),
    ],
)
def test_where_onnx_runtime_cannot_be_loaded_one_line_says_so(tmp_path: Path, arguments: list[str], code: int) -> None:
    (tmp_path / "onnxruntime.py").write_text("raise ImportError('libonnxruntime.so: cannot enable executable stack')\n")
    (tmp_path / "config.toml").write_text("[zenoh]\nenabled = false\n")
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-m", "service", *arguments],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    said = (done.stdout + done.stderr).splitlines()
    (line,) = [one for one in said if "segmenter" in one]
    assert done.returncode == code and "Traceback" not in done.stderr
    for part in ("ONNX Runtime cannot be loaded", "executable stack", "segmenter.kind = 'classical'"):
        assert part in line
