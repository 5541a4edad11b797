"""Found by fire: which fire a name tells, the rows, the error by the spread of fires, in the file and on the screen."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.study.segmentation import ImageScore
from service.commands.study.segmentation.by_fire import by_fire, fire_of
from service.commands.study.segmentation.run import run_segmentation
from service.commands.study.segmentation.table import by_fire_text
from tests.support.odd_pictures import REFUSED
from tests.support.onnx_models import CARD, red_model
from tests.support.places import HANG_S


def scored(is_smoke: bool, is_found: bool, false_segments: int = 0) -> ImageScore:
    return ImageScore(is_smoke, is_found, *[float("nan")] * 5, false_segments, None)


@pytest.mark.parametrize(
    ("stem", "fire"),
    [
        ("20170722_FIRE_hp-e-mobo-c__1500762147_+00900", "20170722"),
        ("20180614_Hope_wc-e__ck0kcn7u1j0vk0a46lr8si8zl", "20180614"),
        ("evoDJI_0001_frame97", ""),
        ("1500762147_+00900", ""),
        ("20170722", ""),
        ("120170722_FIRE", ""),
        ("19991231_x", "19991231"),
    ],
)
def test_a_name_tells_its_day(stem: str, fire: str) -> None:
    assert fire_of(stem) == fire


def test_rows_by_fire_and_the_error_of_all() -> None:
    one = [("20170101", scored(True, True, 1))] * 3 + [("20170101", scored(False, False, 2))]
    other = [("20180101", scored(True, False))]
    got = by_fire([*one, *other, ("", scored(True, True, 9))])
    first, second = got["fires"]
    assert (first["fire"], first["smoke_images"], first["found"], first["found_share"]) == ("20170101", 3, 3, 1.0)
    assert (first["false_per_smoke_image"], first["negative_images"], first["false_per_negative"]) == (1.0, 1, 2.0)
    assert (second["fire"], second["found"], second["false_per_negative"]) == ("20180101", 0, None)
    whole = got["of_all_fires"]
    # by hand: 3 of 4 found; residuals 3 - 0.75 * 3 and 0 - 0.75 * 1; sqrt(2 / 1 * 2 * 0.75^2) / 4
    assert (whole["fire"], whole["smoke_images"], whole["found_share"]) == ("2 fires", 4, 0.75)
    assert whole["found_share_error"] == pytest.approx(1.5 / 4)
    text = by_fire_text(got)
    assert len(text.splitlines()) == 4 and "found 0.75 +- 0.38, by the spread of fires" in text
    assert by_fire([("", scored(True, True))]) == {}


def test_one_fire_has_no_spread_and_the_command_says_it_by_fire(tmp_path: Path) -> None:
    model = red_model(tmp_path / "red.onnx", CARD)
    for name, is_red in (("20170101_a__1.png", True), ("20170101_a__2.png", False), ("plain.png", True)):
        for folder, value in (("images", (0, 0, 255 if is_red else 90)), ("masks", 255)):
            picture = np.full(
                (64, 128, 3) if folder == "images" else (64, 128), 90 if folder == "images" else 0, np.uint8
            )
            picture[10:30, 80:100] = value
            (tmp_path / "in" / folder).mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(tmp_path / "in" / folder / name), picture)
    told: list[str] = []
    run_segmentation([tmp_path / "in"], str(model), None, tmp_path / "out", told.append)
    content = json.loads((tmp_path / "out" / "segmentation.json").read_text())
    (row,) = content["fires"]
    assert (row["fire"], row["smoke_images"], row["found"]) == ("20170101", 2, 1)
    assert content["of_all_fires"]["found_share_error"] is None
    assert any("20170101" in line and "spread" not in line for line in told)
    rows = (tmp_path / "out" / "segmentation.csv").read_text().splitlines()
    assert rows[0].endswith(",fire") and rows[1].endswith(",20170101") and rows[3].endswith(",")


def test_a_picture_that_cannot_be_decoded_is_one_line(tmp_path: Path) -> None:
    suffix, made, words = REFUSED["floats"]
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / f"floats{suffix}").write_bytes(made())
    command = [sys.executable, "-m", "service", "study", "segmentation", str(tmp_path / "in"), "--segmenter", "sobel"]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out")], capture_output=True, text=True, timeout=HANG_S, check=False
    )
    lines = (done.stdout + done.stderr).splitlines()
    assert done.returncode == 0 and [line for line in lines if "ERROR" in line] == []
    assert sum(words in line for line in lines) == 1
