"""The command that makes masks of outlines: what it writes, and when it writes nothing."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import draw_masks
from service.commands.study.images import image_folders, labelled_images

PLUME = "smoke 30,20 50,20 45,60 35,60"


def pictures(folder: Path, count: int) -> Path:
    """Frames a0, a1 and on, 96 x 72, with a plume in each."""
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(7)
    for number in range(count):
        image = rng.integers(40, 90, (72, 96, 3), dtype=np.uint8)
        cv2.fillPoly(image, [np.array([[30, 20], [50, 20], [45, 60], [35, 60]])], (210, 210, 210))
        cv2.imwrite(str(folder / "images" / f"a{number}.png"), image)
    return folder


def run(monkeypatch: pytest.MonkeyPatch, folder: Path, text: str, *arguments: str | Path) -> int:
    (folder / "outlines.txt").write_text(text, encoding="utf-8")
    line = ["draw_masks.py", folder / "outlines.txt", *arguments]
    monkeypatch.setattr(sys, "argv", [str(one) for one in line])
    return draw_masks.main()


def test_what_is_written_is_what_training_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = pictures(tmp_path / "in", 3), tmp_path / "new" / "out"
    assert run(monkeypatch, tmp_path, f"frame a0\n{PLUME}\nframe a2\nnone\n", source, "--out", out) == 0
    assert capsys.readouterr().out == f"{out}: 2 masks, 1 with smoke\n"
    mask = cv2.imread(str(out / "masks" / "a0.png"), cv2.IMREAD_UNCHANGED)
    assert mask is not None
    assert (mask.shape, set(np.unique(mask))) == ((72, 96), {0, 255})
    (folder,) = image_folders([out])
    found = {path.stem: one for path, one in labelled_images(folder, pytest.fail)}
    assert set(found) == {"a0", "a2"}  # not a1: without a mask it would be a frame without smoke
    smoky, empty = found["a0"], found["a2"]
    assert smoky is not None and smoky.truth is not None and smoky.truth.region[30, 40]
    assert empty is not None and empty.truth is None


def test_sheets_hold_every_frame_and_an_earlier_run_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, out = pictures(tmp_path / "in", 16), tmp_path / "out"
    frames = [f"frame a{number}\n{PLUME}\n" for number in range(16)]
    assert run(monkeypatch, tmp_path, "".join(frames), source, "--out", out) == 0
    sizes = {path.name: cv2.imread(str(path)).shape for path in (out / "sheets").iterdir()}
    assert sizes == {"sheet_01.png": (3 * 328, 5 * 384, 3), "sheet_02.png": (328, 384, 3)}
    assert run(monkeypatch, tmp_path, frames[4], source, "--out", out) == 0
    assert [[path.name for path in (out / one).iterdir()] for one in ("images", "masks", "sheets")] == [
        ["a4.png"],
        ["a4.png"],
        ["sheet_01.png"],
    ]


def test_a_fault_is_said_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = pictures(tmp_path / "in", 1), tmp_path / "out"
    assert run(monkeypatch, tmp_path, f"frame a0\n{PLUME}\nframe b\n{PLUME}\n", source, "--out", out) == 1
    assert capsys.readouterr().err == (
        f"{tmp_path}/outlines.txt:3: b: none of the 1 pictures has that name (it goes without the suffix)\n"
    )
    assert run(monkeypatch, tmp_path, f"frame a0\n{PLUME}\n", tmp_path / "nowhere", "--out", out) == 1
    assert capsys.readouterr().err == f"{tmp_path}/nowhere: no such folder\n"
    assert not out.exists()


def test_a_folder_of_others_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source, others = pictures(tmp_path / "in", 1), pictures(tmp_path / "others", 2)
    text = f"frame a0\n{PLUME}\n"
    for out, why in ((source, "holds the pictures that are read"), (others, "was not written by this program")):
        assert run(monkeypatch, tmp_path, text, source, "--out", out) == 1
        assert capsys.readouterr().err.startswith(f"{out}: {why}")
    assert [len(list((one / "images").iterdir())) for one in (source, others)] == [1, 2]
    (tmp_path / "file").write_text("mine")
    assert run(monkeypatch, tmp_path, text, source, "--out", tmp_path / "file") == 1
    assert (tmp_path / "file").read_text() == "mine"


def test_boxes_beside_the_frames_are_a_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    source = pictures(tmp_path / "in", 1)
    (source / "boxes.csv").write_text("image,kind,cx,cy,w,h\na0,smoke,0.41667,0.5555,0.2083,0.5555\n")
    assert run(monkeypatch, tmp_path, f"frame a0\n{PLUME}\n", source, "--out", tmp_path / "out") == 0
    assert "; bounding boxes and boxes.csv: IoU " in capsys.readouterr().out


def test_box_overlap_of_a_box_and_its_half() -> None:
    mask = np.zeros((100, 200), np.uint8)
    mask[20:60, 50:90] = 255
    same = np.array([[70 / 200, 40 / 100, 40 / 200, 40 / 100]])
    assert draw_masks.box_overlap(mask, same) == pytest.approx(1.0)
    halves = np.array([[60 / 200, 0.4, 0.1, 0.4], [80 / 200, 0.4, 0.1, 0.4]])
    assert draw_masks.box_overlap(mask, halves) == pytest.approx(1.0)
    assert draw_masks.box_overlap(mask, halves[:1]) == pytest.approx(0.5)
    assert draw_masks.box_overlap(mask, np.array([[0.8, 0.9, 0.1, 0.1]])) == 0.0


def test_a_sheet_shows_the_part_round_the_smoke() -> None:
    smoke = np.zeros((480, 640), np.uint8)
    smoke[100:110, 600:640] = 255
    rows, columns = draw_masks._view(smoke)
    assert (columns.stop - columns.start, rows.stop - rows.start) == (128, 96)
    assert (columns.stop, rows.start <= 100, rows.stop >= 110) == (640, True, True)
    assert draw_masks._view(np.zeros_like(smoke)) == (slice(0, 480), slice(0, 640))
