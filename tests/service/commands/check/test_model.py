"""`distloc check --model`: what it says, the overlay that it writes, and one line for what is wrong."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from service.commands.cli import app
from tests.support.onnx_models import CARD, red_model


def checked(*arguments: str | Path) -> tuple[int, list[str]]:
    """The exit code and the lines."""
    result = CliRunner().invoke(app, ["check", *map(str, arguments)])
    return result.exit_code, result.stdout.splitlines()


@pytest.fixture
def image(tmp_path: Path) -> Path:
    pixels = np.zeros((128, 256, 3), np.uint8)
    pixels[20:60, 100:140] = (0, 0, 255)
    cv2.imwrite(str(tmp_path / "image.png"), pixels)
    return tmp_path / "image.png"


def test_it_says_what_the_model_takes_gives_and_sees(tmp_path: Path, image: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD | {"version": "t1"}, ("N", 3, "height", "width"))
    code, lines = checked("--model", path, "--image", image, "--out", tmp_path / "seen.png")
    assert code == 0, lines
    said = dict(line.split(": ", 1) for line in lines)
    assert said["ok    input"] == "x0  float  N (free) x 3 x height (free) x width (free)"
    assert said["ok    output"].startswith("odd/name:0  float")
    assert "input_width = 64" in said["ok    metadata"] and "version = t1" in said["ok    metadata"]
    assert "ExecutionProvider" in said["ok    provider"]
    assert "ms a run at 64 x 32" in said["ok    time"]
    assert said["ok    image"] == "1 segment above 0.5"
    assert said["ok    segment"].startswith("centre (120, 40), 40 x 40 px, 4.88% of the frame, score 1.00")
    drawn = cv2.imread(str(tmp_path / "seen.png"))
    assert drawn is not None and drawn.shape == (128, 256, 3)
    assert (drawn == (0, 255, 255)).all(axis=2).sum() > 100


def test_what_a_model_says_of_itself_says_nothing_to_the_terminal(tmp_path: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD | {"version": "t1\x1b[2J\nok    input: mine"})
    code, lines = checked("--model", path)
    assert code == 0 and all(line.isprintable() for line in lines), lines
    assert "version = t1\\x1b[2J\\nok    input: mine" in "\n".join(lines)


def test_without_an_image_it_times_a_grey_frame_of_the_configs_size(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text("[camera]\nwidth = 320\nheight = 160\nhfov_deg = 60.0\n[segmenter]\ntiles = 2\n")
    code, lines = checked("--model", red_model(tmp_path / "red.onnx", CARD), "--config", config)
    assert code == 0 and "64 x 32" in lines[-1] and "and 4 tiles" in lines[-1]


def test_the_configs_preprocessing_is_used(tmp_path: Path, image: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text(
        '[camera]\nwidth = 256\nheight = 128\nhfov_deg = 60.0\n[segmenter.preprocessing]\ncolour = "RGB"\n'
    )
    path = red_model(tmp_path / "red.onnx", CARD | {"colour": "BGR"})
    out = tmp_path / "overlay.png"
    code, lines = checked("--model", path, "--config", config, "--image", image, "--out", out)
    assert code == 0 and "ok    config: colour = RGB" in lines and "1 segment above" in " ".join(lines)


@pytest.mark.parametrize(
    ("model", "picture", "words"),
    [
        ("missing.onnx", "image.png", "no such file"),
        ("broken.onnx", "image.png", "not a model"),
        ("bare.onnx", "image.png", "lacks distloc.input_width, distloc.input_height"),
        ("red.onnx", "missing.png", "no image that can be read"),
        ("red.onnx", "broken.onnx", "no image that can be read"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, image: Path, model: str, picture: str, words: str) -> None:
    (tmp_path / "broken.onnx").write_bytes(b"nothing")
    red_model(tmp_path / "bare.onnx", {})
    red_model(tmp_path / "red.onnx", CARD)
    code, lines = checked("--model", tmp_path / model, "--image", tmp_path / picture, "--out", tmp_path / "o.png")
    failed = [line for line in lines if line.startswith("fail")]
    assert code == 1 and len(failed) == 1 and words in failed[0] and lines[-1] == failed[0]
    assert not (tmp_path / "o.png").exists()


def test_an_overlay_that_cannot_be_written_is_told(tmp_path: Path, image: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD)
    for out in (tmp_path / "nowhere" / "o.png", tmp_path, Path(".")):
        code, lines = checked("--model", path, "--image", image, "--out", out)
        assert code == 1 and lines[-1].startswith("fail  overlay: ") and "cannot be written" in lines[-1]
    assert not tmp_path.with_name(f"{tmp_path.name}.part").exists()
