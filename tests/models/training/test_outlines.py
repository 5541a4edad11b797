"""The outlines' file: what it says, and a line for each of its faults."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from outlines import Outlined, OutlinesError, check_pictures, drawn_smoke, read_outlines
from tests.support.places import DATA, ROOT

OURS = ROOT / "models" / "training" / "smoke_hpwren.outlines.txt"
TRIANGLE = "smoke 2,2 8,2 5,7"


def written(folder: Path, text: str) -> Path:
    path = folder / "outlines.txt"
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(folder: Path, text: str) -> list[str]:
    path = written(folder, text)
    with pytest.raises(OutlinesError) as caught:
        read_outlines(path)
    return str(caught.value).replace(str(path), "FILE").splitlines()


def picture_faults(folder: Path, text: str, files: dict[str, Path]) -> list[str]:
    path = written(folder, text)
    with pytest.raises(OutlinesError) as caught:
        check_pictures(path, read_outlines(path), files)
    return str(caught.value).replace(str(folder), "DIR").splitlines()


def picture(folder: Path, name: str, width: int = 40, height: int = 30) -> dict[str, Path]:
    path = folder / f"{name}.png"
    cv2.imwrite(str(path), np.full((height, width, 3), 90, np.uint8))
    return {name: path}


def test_frames_polygons_and_lines_are_read(tmp_path: Path) -> None:
    text = f"# ours\n\nframe a b\n{TRIANGLE}  # the plume\nclear 0,0 3,0 0,3 1,1\n\nframe c\nnone\n"
    first, second = read_outlines(written(tmp_path, text))
    assert (first.name, first.line, first.has_smoke) == ("a b", 3, True)
    assert [(one.kind, one.line, one.corners_px.tolist()) for one in first.polygons] == [
        ("smoke", 4, [[2, 2], [8, 2], [5, 7]]),
        ("clear", 5, [[0, 0], [3, 0], [0, 3], [1, 1]]),
    ]
    assert (second.name, second.line, second.has_smoke, second.polygons) == ("c", 7, False, ())


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (f"{TRIANGLE}\n", "FILE:1: comes before the first frame: begin with frame NAME"),
        ("frame\n", "FILE:1: a frame without a name: frame NAME"),
        ("frame a\nsmoke 1,1 2,2\n", "FILE:2: 2 points: a polygon has 3 or more"),
        ("frame a\nsmoke\n", "FILE:2: 0 points: a polygon has 3 or more"),
        ("frame a\nsmoke 1,1 2,x 3,3\n", "FILE:2: '2,x' is no point: x,y in whole pixels, without a space"),
        ("frame a\nsmoke 1,1 2.5,2 3,3\n", "FILE:2: '2.5,2' is no point: x,y in whole pixels, without a space"),
        ("frame a\nsmoke 1, 1 2,2 3,3\n", "FILE:2: '1,' is no point: x,y in whole pixels, without a space"),
        ("frame a\nsmoke 1,1 2,2 9999999,3\n", "FILE:2: '9999999,3' is no point: x,y in whole pixels, without a space"),
        (
            "frame a\nsmoek 1,1 2,2 3,3\n",
            "FILE:2: 'smoek' is no statement: frame NAME, smoke x,y ..., clear x,y ... or none",
        ),
        ("frame a\nnone 1,1\n", "FILE:2: none stands alone, without points"),
        (f"frame a\nnone\n{TRIANGLE}\n", "FILE:1: a: has both smoke and none: leave one out"),
        (
            "frame a\nclear 1,1 2,2 3,3\n",
            "FILE:1: a: has neither smoke nor none: add a polygon, or none where no smoke is seen",
        ),
        (f"frame a\n{TRIANGLE}\nframe a\nnone\n", "FILE:3: a: already on line 1: keep one of the two"),
        ("# nothing\n", "FILE: has no frame: frame NAME, smoke x,y ..., clear x,y ... or none"),
    ],
)
def test_a_malformed_line_is_named(tmp_path: Path, text: str, fault: str) -> None:
    assert faults_of(tmp_path, text) == [fault]


def test_every_fault_has_its_line(tmp_path: Path) -> None:
    found = faults_of(tmp_path, "frame a\nsmoke 1,1\nframe b\nwhat\n")
    assert [line.split(":")[1] for line in found] == ["2", "4"]


def test_a_file_that_is_none_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x81")
    for path in (tmp_path / "missing", tmp_path, tmp_path / "binary"):
        with pytest.raises(OutlinesError) as caught:
            read_outlines(path)
        assert str(caught.value).startswith(f"{path}: ")
        assert "\n" not in str(caught.value)


def test_a_missing_or_unreadable_picture_is_named(tmp_path: Path) -> None:
    (tmp_path / "b.jpg").write_bytes(b"no picture")
    files = {**picture(tmp_path, "a"), "b": tmp_path / "b.jpg"}
    text = f"frame a\n{TRIANGLE}\nframe a.png\n{TRIANGLE}\nframe b\n{TRIANGLE}\n"
    assert picture_faults(tmp_path, text, files) == [
        "DIR/outlines.txt:3: a.png: none of the 2 pictures has that name (it goes without the suffix)",
        "DIR/outlines.txt:5: DIR/b.jpg: cannot be read: give a PNG or JPEG",
    ]


def test_a_point_off_the_frame_is_named_and_one_on_its_edge_is_not(tmp_path: Path) -> None:
    files = picture(tmp_path, "a")
    path = written(tmp_path, "frame a\nsmoke 0,0 40,0 40,30 0,30\n")
    check_pictures(path, read_outlines(path), files)
    for point in ("41,0", "0,31", "-1,5"):
        found = picture_faults(tmp_path, f"frame a\n{TRIANGLE}\nclear 1,1 5,5 {point}\n", files)
        assert found == [f"DIR/outlines.txt:3: {point} is off the frame: x is 0 to 40, y 0 to 30"]


def test_smoke_that_covers_nothing_is_a_fault(tmp_path: Path) -> None:
    for smoke in (f"{TRIANGLE}\nclear 0,0 20,0 20,20 0,20", "smoke 40,0 40,30 40,10"):
        found = picture_faults(tmp_path, f"frame a\n{smoke}\n", picture(tmp_path, "a"))
        assert found == [
            "DIR/outlines.txt:1: a: its smoke covers no pixel: all of it is clear or on the far edge",
        ]


def test_polygons_that_overlap_are_filled_both(tmp_path: Path) -> None:
    text = "frame a\nsmoke 2,2 10,2 10,10 2,10\nsmoke 6,6 14,6 14,14 6,14\nclear 2,2 4,2 4,4 2,4\n"
    (one,) = read_outlines(written(tmp_path, text))
    drawn = drawn_smoke(one, 30, 40)
    assert drawn[8, 8] == 1  # in both
    assert drawn[3, 3] == 0  # cleared
    assert int(drawn.sum()) == 2 * 81 - 25 - 9


def test_ours_are_whole() -> None:
    ours = read_outlines(OURS)
    fires = {one.name.split("__")[0].removesuffix("-mono") for one in ours}
    assert (len(ours), len(fires)) == (160, 13)  # as README.md beside them says
    assert all(one.has_smoke for one in ours)


def test_ours_fit_their_frames() -> None:
    folder = DATA / "smoke_hpwren_boxes" / "images"
    if not folder.is_dir():
        pytest.skip("the frames are not part of the project")
    ours: list[Outlined] = read_outlines(OURS)
    check_pictures(OURS, ours, {path.stem: path for path in folder.iterdir()})
