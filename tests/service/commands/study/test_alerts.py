"""`study alerts` end to end on small sequences, and what it says to bad input."""

import csv
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from service.commands.cli import main
from service.commands.study.alerts.run import THRESHOLDS, checked_thresholds, run_alerts
from service.commands.study.images import ImageFolderError
from service.config.sections import ConfigError
from tests.support.onnx_models import CARD, red_model

IGNITION = 1_465_065_600
SMOKE, CLOUD = (20, 40, 80, 100), (40, 50, 10, 20)  # top, bottom, left, right


def write(
    folder: Path, camera: str, second: int, red: dict[tuple[int, int, int, int], int], *, mask: bool = False
) -> Path:
    """A frame in black with blocks of red of these levels; with a mask of the smoke where it is asked for."""
    image = np.zeros((64, 128, 3), np.uint8)
    for (top, bottom, left, right), level in red.items():
        image[top:bottom, left:right, 2] = level
    (folder / "images").mkdir(parents=True, exist_ok=True)
    path = folder / "images" / f"{camera}__{IGNITION + second}_{second:+06d}.png"
    cv2.imwrite(str(path), image)
    if mask:
        (folder / "masks").mkdir(exist_ok=True)
        smoke = np.zeros((64, 128), np.uint8)
        smoke[SMOKE[0] : SMOKE[1], SMOKE[2] : SMOKE[3]] = 1
        cv2.imwrite(str(folder / "masks" / path.name), smoke)
    return path


def flown(folder: Path, model: Path, said: list[str], *, folders: tuple[str, ...] = ("before", "after")) -> Any:
    run_alerts([folder / one for one in folders], str(model), (0.3, 0.5), folder / "out", said.append)
    return json.loads((folder / "out" / "alerts.json").read_text())


def test_a_sequence_over_two_folders(tmp_path: Path) -> None:
    """The smoke's red is 0.9 of full, a cloud's before it 0.47, which the model gives 0.35."""
    model = red_model(tmp_path / "red.onnx", CARD | {"threshold": "0.6"})
    for minute in range(-9, 1):
        write(tmp_path / "before", "cam", 60 * minute, {CLOUD: 120})
    for minute in range(1, 13):
        write(tmp_path / "after", "cam", 60 * minute, {SMOKE: 230} if minute > 2 else {}, mask=True)
    said: list[str] = []
    got = flown(tmp_path, model, said)
    assert got["segmenter"].startswith("onnx red") and got["own_threshold"] == 0.6
    assert got["frames_at_one_place"] == {"tentative": "4 of 6", "confirmed": "8 of 12"}
    assert [row["threshold"] for row in got["curve"]] == [0.3, 0.5, 0.6]
    low, middle, own = got["curve"]
    for row in (low, middle, own):
        assert (row["fires"], row["hours_before"]) == (1, 0.15)
        assert [row[f"{level}_after_s"] for level in ("segment", "tentative", "confirmed")] == [180.0, 360.0, 600.0]
    assert [low[f"{level}_false"] for level in ("segment", "tentative", "confirmed")] == [1, 1, 1]
    assert low["confirmed_false_per_hour"] == pytest.approx(1 / 0.15, abs=1e-3)
    assert middle["segment_false"] == own["segment_false"] == 0
    names = ["alerts.csv", "alerts.json", "alerts.png", "alerts.txt"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    with (tmp_path / "out" / "alerts.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [(line["sequence"], line["threshold"], line["frames_before"]) for line in lines] == [
        ("cam", "0.3", "10"),
        ("cam", "0.5", "10"),
        ("cam", "0.6", "10"),
    ]
    assert (tmp_path / "out" / "alerts.txt").read_text() == said[0] + "\n"
    (marked,) = [line for line in said[0].splitlines() if line.endswith("own")]
    assert marked.split()[0] == "0.6"
    picture = cv2.imread(str(tmp_path / "out" / "alerts.png"))
    assert picture is not None and picture.std() > 5.0


def test_a_segmenter_without_a_threshold_is_one_point(tmp_path: Path) -> None:
    for minute in range(-2, 3):
        write(tmp_path / "in", "cam", 60 * minute, {})
    run_alerts([tmp_path / "in"], "sobel", THRESHOLDS, tmp_path / "out", lambda line: None)
    got = json.loads((tmp_path / "out" / "alerts.json").read_text())
    assert [row["threshold"] for row in got["curve"]] == [None] and got["segmenter"] == "sobel"
    assert got["curve"][0]["segment_after_s"] is None and got["curve"][0]["segment_told"] == 0


def test_what_cannot_be_used_is_told_and_left_out(tmp_path: Path) -> None:
    model = red_model(tmp_path / "red.onnx", CARD)
    for minute in range(1, 6):
        write(tmp_path / "after", "cam", 60 * minute, {SMOKE: 230})
    write(tmp_path / "after", "other", 60, {})
    folder = tmp_path / "after" / "images"
    cv2.imwrite(str(folder / "mosaic.png"), np.zeros((64, 128, 3), np.uint8))
    cv2.imwrite(str(folder / f"cam__{IGNITION + 360}_+00360.png"), np.zeros((64, 100, 3), np.uint8))
    (folder / f"cam__{IGNITION + 420}_+00420.png").write_bytes(b"no image")
    (folder / f"cam__{IGNITION + 60}_+00060.tif").write_bytes(b"no image")
    said: list[str] = []
    got = flown(tmp_path, model, said, folders=("after",))
    assert got["sequences"][0]["frames_after"] == 5 and got["curve"][0]["tentative_told"] == 1
    told = "\n".join(said)
    for words in (
        "1 images whose names tell no time",
        "1 sequences of a single frame; left out",
        "is 100 x 64, the sequence 128 x 64; left out",
        "+00420.png: is no PNG, JPEG, BMP or TIFF; left out",
        "+00060.tif: another frame is of the same time; left out",
    ):
        assert told.count(words) == 1, told


def test_two_fires_of_one_camera_are_two_sequences(tmp_path: Path) -> None:
    for second in range(60, 361, 60):
        path = write(tmp_path / "in", "cam", second, {SMOKE: 230})
        later = IGNITION + 9000 + second + second // 60  # its clock jitters
        (path.parent / f"cam__{later}_{second:+06d}.png").write_bytes(path.read_bytes())
    said: list[str] = []
    got = flown(tmp_path, red_model(tmp_path / "red.onnx", CARD), said, folders=("in",))
    names = {row["sequence"]: row["frames_after"] for row in got["sequences"]}
    assert names == {f"cam__{IGNITION}": 6, f"cam__{IGNITION + 9001}": 6}
    assert got["curve"][0]["fires"] == got["curve"][0]["tentative_told"] == 2 and len(said) == 2


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    model = str(red_model(tmp_path / "red.onnx", CARD))
    cv2.imwrite(str(tmp_path / "frame_1.png"), np.zeros((64, 128, 3), np.uint8))
    with pytest.raises(ImageFolderError, match=r"frame_1\.png: its name tells no time .* UNIX_\+SECONDS"):
        run_alerts([tmp_path], model, THRESHOLDS, tmp_path / "out", lambda line: None)
    write(tmp_path / "one", "cam", 60, {})
    with pytest.raises(ImageFolderError, match="no sequence: each of the 1 has a single frame"):
        run_alerts([tmp_path / "one"], model, THRESHOLDS, tmp_path / "out", lambda line: None)
    for text in ("0.5,high", "0", "0.5,1.5", ",", "nan"):
        with pytest.raises(ConfigError, match=r"--thresholds is .*: it must be numbers above 0 and below 1"):
            checked_thresholds(text)
    assert checked_thresholds("0.9,0.5,0.9") == (0.5, 0.9) and checked_thresholds("") == THRESHOLDS
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "names"),
    [
        (["gone"], 1, "gone: no such folder"),
        (["in", "--thresholds", "high"], 78, "--thresholds is 'high'"),
        (["in", "--segmenter", "yolo"], 78, "--segmenter is 'yolo'"),
        (["in", "--segmenter", "a.tflite"], 78, "no such file"),
    ],
)
def test_the_command_says_what_is_wrong_in_one_line(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    code: int,
    names: str,
) -> None:
    for second in (60, 120):
        write(tmp_path / "in", "cam", second, {})
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["distloc", "study", "alerts", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    (line,) = capfd.readouterr().err.splitlines()
    assert ended.value.code == code and line.startswith("distloc: ") and names in line


def test_the_configs_threshold_is_the_models_own(tmp_path: Path) -> None:
    for second in (60, 120):
        write(tmp_path / "in", "cam", second, {})
    (tmp_path / "config.toml").write_text("[segmenter]\nthreshold = 0.8\n")
    model = str(red_model(tmp_path / "red.onnx", CARD))
    run_alerts([tmp_path / "in"], model, (0.5,), tmp_path / "out", lambda line: None, tmp_path / "config.toml")
    got = json.loads((tmp_path / "out" / "alerts.json").read_text())
    assert got["own_threshold"] == 0.8 and [row["threshold"] for row in got["curve"]] == [0.5, 0.8]
