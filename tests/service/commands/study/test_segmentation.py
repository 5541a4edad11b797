"""The segmentation study: scores by hand, the folders' layouts, and the command end to end."""

import csv
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.renderer import Plume, Renderer
from distloc.study.segmentation import (
    ImageScore,
    Truth,
    rank,
    score_image,
    summarised,
    truth_from_boxes,
    truth_from_mask,
)
from distloc.types import BoolArray, CameraPose, MaskArray, RejectReason
from service.commands.cli import main
from service.commands.study.images import ImageFolderError, image_folders, labelled_images
from service.commands.study.segmentation import run as study_segmentation
from service.commands.study.segmentation.overlay import FOUND_BGR, TRUTH_BGR, sheet, tile
from service.commands.study.segmentation.run import run_segmentation
from service.common.image_header import turned
from service.common.messages import Frame
from service.config.sections import ConfigError, SegmenterConfig
from tests.support.odd_pictures import REFUSED, scene, with_orientation
from tests.support.onnx_models import CARD, exported_model, red_model
from tests.support.places import DATA

CAMERA = Camera(64, 48, 64.0, 64.0, 31.5, 23.5)
FLOODED = RejectReason.SEGMENTATION_FLOODED


def block(*sides: tuple[int, int, int, int], size: tuple[int, int] = (48, 64)) -> BoolArray:
    """A mask with rectangles: first row, last row, first column, last column."""
    mask = np.zeros(size, np.bool_)
    for top, bottom, left, right in sides:
        mask[top : bottom + 1, left : right + 1] = True
    return mask


def score(mask: MaskArray | RejectReason, truth: BoolArray | None, camera: Camera = CAMERA) -> ImageScore:
    return score_image(mask, None if truth is None else truth_from_mask(truth), camera)


def quiet(line: str) -> None:
    pass


# Scores of one image


def test_scores_of_two_rectangles_by_hand() -> None:
    one = score(block((13, 26, 24, 33)), block((10, 19, 20, 29)))  # 14 x 10 px found of 10 x 10, 7 x 6 in common
    assert one.is_smoke and one.is_found and one.false_segments == 0 and one.rejected is None
    assert one.iou == pytest.approx(42 / 198)
    assert one.precision == pytest.approx(0.3) and one.recall == pytest.approx(0.42)
    assert one.centroid_error_px == pytest.approx(np.hypot(28.5 - 24.5, 19.5 - 14.5))
    assert one.base_error_px == pytest.approx(np.hypot(28.5 - 24.5, 26.5 - 19.5))


def test_a_coarse_mask_is_scored_at_full_size() -> None:
    coarse = block((5, 8, 10, 13), size=(24, 32)).astype(np.uint8) * 255
    one = score(coarse, block((10, 17, 20, 27)))
    assert (one.iou, one.precision, one.recall) == (1.0, 1.0, 1.0)
    assert one.centroid_error_px == pytest.approx(0.0) and one.base_error_px == pytest.approx(0.0)


@pytest.mark.parametrize(("width", "beside", "is_found"), [(512, 10, True), (512, 11, False), (1024, 20, True)])
def test_beside_the_smoke_counts_as_found_up_to_10_px_of_512(width: int, beside: int, is_found: bool) -> None:
    camera = Camera(width, 32, 100.0, 100.0, 0.0, 0.0)
    truth = block((10, 13, 100, 109), size=(32, width))
    middle = 109.5 + beside  # the truth's last pixels end at 109.5
    found = block((10, 13, int(middle - 1.5), int(middle + 1.5)), size=(32, width))
    one = score(found, truth, camera)
    assert one.is_found is is_found and one.false_segments == int(not is_found)
    assert one.centroid_error_px == pytest.approx(middle - 104.5 if is_found else np.nan, nan_ok=True)


def test_the_centroid_is_of_the_area_and_corners_join() -> None:
    bent = block((0, 19, 10, 11), (20, 21, 12, 31))  # touch at a corner; 40 px each, the box's middle is (20.5, 10.5)
    truth = truth_from_mask(block((14, 16, 15, 17)))
    assert truth is not None
    one = score_image(bent, truth, CAMERA)
    assert one.is_found and one.false_segments == 0
    assert one.centroid_error_px == pytest.approx(0.0)


def test_only_segments_of_12_px_count_but_every_pixel_does() -> None:
    truth = block((10, 19, 20, 29))
    speck, segment = block((40, 40, 0, 10)), block((40, 40, 30, 41))
    assert score(speck, None).false_segments == 0
    assert score(segment, None).false_segments == 1
    one = score(truth | speck, truth)
    assert one.iou == pytest.approx(100 / 111) and one.precision == pytest.approx(100 / 111)
    assert one.false_segments == 0


def test_the_nearest_of_the_segments_on_the_smoke_has_the_errors() -> None:
    truth = block((10, 29, 10, 29))  # centre (19.5, 19.5), base (19.5, 29.5)
    near, larger, outside = (15, 19, 15, 19), (22, 28, 11, 28), (40, 47, 40, 63)
    one = score(block(near, larger, outside), truth)
    assert one.is_found and one.false_segments == 1
    assert one.centroid_error_px == pytest.approx(np.hypot(2.5, 2.5))
    assert one.base_error_px == pytest.approx(np.hypot(17.0 - 19.5, 19.5 - 29.5))


def test_smoke_that_is_missed_has_no_errors() -> None:
    one = score(block((40, 47, 40, 63)), block((10, 19, 20, 29)))
    assert not one.is_found and one.false_segments == 1
    assert (one.iou, one.precision, one.recall) == (0.0, 0.0, 0.0)
    assert np.isnan([one.centroid_error_px, one.base_error_px]).all()


def test_a_refusal_is_no_segments() -> None:
    one = score(FLOODED, block((10, 19, 20, 29)))
    assert one.rejected is FLOODED and not one.is_found and one.false_segments == 0
    assert (one.iou, one.recall) == (0.0, 0.0) and np.isnan(one.precision)
    assert score(FLOODED, None).false_segments == 0


def test_a_negative_has_false_segments_alone() -> None:
    one = score(block((0, 3, 0, 3), (40, 43, 0, 3)), None)
    assert not one.is_smoke and not one.is_found and one.false_segments == 2
    assert np.isnan([one.iou, one.precision, one.recall, one.centroid_error_px, one.base_error_px]).all()
    assert score(block(), None).false_segments == 0
    assert truth_from_mask(block()) is None


def test_boxes_are_found_by_their_centres() -> None:
    camera = Camera(100, 50, 100.0, 100.0, 49.5, 24.5)
    boxes = np.array([[0.5, 0.5, 0.2, 0.4], [0.9, 0.2, 0.1, 0.2]])
    truth = truth_from_boxes(boxes, 100, 50)
    assert truth is not None
    assert np.array_equal(truth.region, block((15, 34, 40, 59), (5, 14, 85, 94), size=(50, 100)))
    assert truth.centres_px == pytest.approx(np.array([[49.5, 24.5], [89.5, 9.5]]))
    one = score_image(block((5, 10, 84, 89), (40, 49, 0, 9), size=(50, 100)), truth, camera)
    assert one.is_found and one.false_segments == 1
    assert one.centroid_error_px == pytest.approx(np.hypot(86.5 - 89.5, 7.5 - 9.5))
    assert np.isnan([one.iou, one.precision, one.recall, one.base_error_px]).all()


def test_what_is_no_box_is_refused() -> None:
    assert truth_from_boxes(np.zeros((0, 4)), 100, 50) is None
    tiny = truth_from_boxes(np.array([[1.0, 0.0, 1e-6, 1e-6]]), 100, 50)
    assert tiny is not None and np.argwhere(tiny.region).tolist() == [[0, 99]]
    for wrong in ([1.2, 0.5, 0.1, 0.1], [0.5, 0.5, 0.0, 0.1], [0.5, np.nan, 0.1, 0.1]):
        with pytest.raises(ValueError, match="box"):
            truth_from_boxes(np.array([wrong]), 100, 50)


def test_a_mask_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="48 x 64"):
        score(block(size=(20, 20)), None)


# The summary of many


def test_summary_by_hand() -> None:
    truth = block((10, 19, 20, 29))
    scores = [
        score(truth, truth),
        score(block((10, 19, 20, 24)), truth),  # half of it: 2.5 px off, base as well
        score(FLOODED, truth),
        score(block((0, 3, 0, 3), (40, 43, 0, 3)), None),
        score(block(), None),
        score(FLOODED, None),
    ]
    found = summarised(scores, [1.0, 9.0, 2.0, 2.0, 4.0, 100.0])
    assert (found.smoke_images, found.negative_images) == (3, 3)
    assert found.found_share == pytest.approx(2 / 3)
    assert found.iou_mean == pytest.approx((1.0 + 0.5 + 0.0) / 3) and found.recall == pytest.approx(0.5)
    assert found.precision == 1.0  # of the two that claim something
    assert found.centroid_error_px_median == pytest.approx(1.25) and found.base_error_px_median == pytest.approx(1.25)
    assert found.false_per_smoke_image == 0.0 and found.false_per_negative == pytest.approx(2 / 3)
    assert found.ms_median == pytest.approx(3.0)
    assert found.rejected == {"segmentation_flooded": 2}


def test_summary_of_nothing_is_nan() -> None:
    found = summarised([], [])
    assert (found.smoke_images, found.negative_images, found.rejected) == (0, 0, {})
    means = [found.found_share, found.iou_mean, found.centroid_error_px_median, found.false_per_negative]
    assert np.isnan([*means, found.ms_median]).all()


def test_rank_is_from_best_to_worst() -> None:
    truth = block((10, 19, 20, 29))
    ordered = [
        score(truth, truth),
        score(block((10, 19, 20, 24)), truth),
        score(block(), truth),
        score(FLOODED, truth),
        score(block((40, 47, 40, 63)), truth),
        score(block(), None),
        score(block((0, 3, 0, 3)), None),
        score(block((0, 3, 0, 3), (40, 43, 0, 3)), None),
    ]
    assert sorted(ordered[::-1], key=rank) == ordered


# Folders


def write(path: Path, image: np.ndarray[Any, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def grey(width: int = 64, height: int = 48) -> np.ndarray[Any, Any]:
    return np.full((height, width, 3), 90, np.uint8)


def truths(path: Path, told: list[str] | None = None) -> dict[str, Truth | str | None]:
    """Each image's truth by its file's name; "unreadable" where there is none."""
    say = quiet if told is None else told.append
    return {
        image.name: "unreadable" if labelled is None else labelled.truth
        for image, labelled in labelled_images(image_folders([path])[0], say)
    }


def test_masks_of_either_kind(tmp_path: Path) -> None:
    smoke = block((10, 19, 20, 29))
    for folder, stem, values in (
        ("ones", "ones", smoke.astype(np.uint8)),
        ("ones", "colour", smoke[..., None] * np.array([0, 0, 1], np.uint8)),
        ("bytes", "bytes", smoke.astype(np.uint8) * 255),
        ("bytes", "palette", smoke[..., None] * np.array([0, 0, 128], np.uint8)),
    ):
        for name in (stem, "zero", "none"):
            write(tmp_path / folder / "images" / f"{name}.png", grey())
        write(tmp_path / folder / "masks" / f"{stem}.png", values)
        write(tmp_path / folder / "masks" / "zero.png", block().astype(np.uint8))
    boxes = "image,width,height,cx,cy,w,h,kind\nnone,64,48,0.5,0.5,0.2,0.2,gt_box\n"
    (tmp_path / "bytes" / "boxes.csv").write_text(boxes)
    for folder, stems in (("ones", ("ones", "colour")), ("bytes", ("bytes", "palette"))):
        got = truths(tmp_path / folder)
        for stem in stems:
            truth = got[f"{stem}.png"]
            assert isinstance(truth, Truth) and truth.is_mask and np.array_equal(truth.region, smoke)
            assert truth.centres_px == pytest.approx(np.array([[24.5, 14.5]]))
        assert got["zero.png"] is None and got["none.png"] is None


def test_a_mask_of_1_beside_masks_of_255_is_left_out(tmp_path: Path) -> None:
    smoke = block((10, 19, 20, 29)).astype(np.uint8)
    for stem, values in (("a", smoke * 255), ("b", smoke)):
        write(tmp_path / "images" / f"{stem}.png", grey())
        write(tmp_path / "masks" / f"{stem}.png", values)
    told: list[str] = []
    assert truths(tmp_path, told)["b.png"] == "unreadable"
    assert len(told) == 1 and "b.png: no pixel above 127 though some above 0" in told[0]


@pytest.mark.parametrize("is_drawn_as_shown", [False, True])
def test_exif_turns_image_and_mask_alike(tmp_path: Path, is_drawn_as_shown: bool) -> None:
    raw = scene(64, 48)
    smoke = block((10, 19, 40, 59))
    upright = turned(smoke, 6)
    write(tmp_path / "masks" / "a.png", (upright if is_drawn_as_shown else smoke).astype(np.uint8) * 255)
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "a.jpg").write_bytes(with_orientation(raw, "JPEG", 6))
    (got,) = [one for _, one in labelled_images(image_folders([tmp_path])[0], quiet)]
    assert got is not None and got.truth is not None
    assert got.image.shape == (64, 48, 3) and np.array_equal(got.truth.region, upright)


def test_masks_and_boxes_of_other_names_are_errors_and_not_no_smoke(tmp_path: Path) -> None:
    write(tmp_path / "a" / "images" / "1.jpg", grey())
    write(tmp_path / "a" / "masks" / "1_mask.png", grey())
    with pytest.raises(ImageFolderError, match=r"masks: none of its 1 files \(1_mask.png .*that of 1 is 1.png"):
        image_folders([tmp_path / "a"])
    write(tmp_path / "b" / "images" / "1.jpg", grey())
    (tmp_path / "b" / "boxes.csv").write_text("image,cx,cy,w,h,kind\n1.jpg,0.5,0.5,0.2,0.2,gt\n")
    with pytest.raises(ImageFolderError, match=r"boxes.csv: none of its 1 images \('1.jpg' .* 1.jpg is named '1'"):
        image_folders([tmp_path / "b"])


def test_masks_and_boxes_of_no_image_are_told(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        write(tmp_path / folder / "images" / "1.jpg", grey())
    for stem in ("1", "2", "3"):
        write(tmp_path / "a" / "masks" / f"{stem}.png", np.zeros((48, 64), np.uint8))
    rows = "".join(f"{stem},0.5,0.5,0.2,0.2,gt\n" for stem in ("1", "7"))
    (tmp_path / "b" / "boxes.csv").write_text("image,cx,cy,w,h,kind\n" + rows)
    told: list[str] = []
    run_segmentation([tmp_path / "a", tmp_path / "b"], "sobel", None, tmp_path / "out", told.append)
    assert told[:2] == [
        "a: 2 masks are of no image in the folder: 2.png ...",
        "b: 1 images of boxes.csv are of no image in the folder: 7 ...",
    ]


def test_odd_pictures_are_one_line_each(tmp_path: Path) -> None:
    write(tmp_path / "good.png", grey())
    for name, (suffix, made, _) in REFUSED.items():
        (tmp_path / f"{name}{suffix}").write_bytes(made())
    told: list[str] = []
    got = truths(tmp_path, told)
    assert got.pop("good.png") is None
    assert set(got.values()) == {"unreadable"} and len(told) == len(got) == len(REFUSED)
    for name, (suffix, _, words) in REFUSED.items():
        (line,) = [line for line in told if f"/{name}{suffix}: " in line]
        assert words in line and line.endswith("; left out") and "\n" not in line


def test_boxes_but_no_false_alarms(tmp_path: Path) -> None:
    for name in ("smoke.jpg", "sky.jpg", "unlisted.jpg"):
        write(tmp_path / "images" / name, grey())
    (tmp_path / "boxes.csv").write_text(
        "image,width,height,cx,cy,w,h,kind\n"
        "smoke,64,48,0.5,0.5,0.25,0.25,gt_box\n"
        "smoke,64,48,0.1,0.1,0.1,0.1,yolo_detection_box_false_alarm\n"
        "sky,64,48,0.5,0.5,0.25,0.25,yolo_detection_box_false_alarm\n"
    )
    got = truths(tmp_path)
    smoke = got["smoke.jpg"]
    assert isinstance(smoke, Truth) and not smoke.is_mask
    assert np.array_equal(smoke.region, block((18, 29, 24, 39)))
    assert got["sky.jpg"] is None and got["unlisted.jpg"] is None


def test_neither_is_all_negative_and_a_plain_folder_will_do(tmp_path: Path) -> None:
    write(tmp_path / "images" / "a.png", grey())
    write(tmp_path / "sky_masks" / "a.png", np.full((48, 64), 255, np.uint8))
    (tmp_path / "label.csv").write_text("filename,slope,offset\na.png,0.5,0.1\n")
    assert truths(tmp_path) == {"a.png": None}
    assert truths(tmp_path / "images") == {"a.png": None}


def test_an_image_or_mask_that_cannot_be_read_is_a_line(tmp_path: Path) -> None:
    for stem in ("bad_mask", "good", "other_size"):
        write(tmp_path / "images" / f"{stem}.png", grey())
    (tmp_path / "images" / "bad.jpg").write_bytes(b"no image")
    (tmp_path / "images" / "empty.jpg").touch()
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / "bad_mask.png").write_bytes(b"no image")
    write(tmp_path / "masks" / "other_size.png", np.zeros((48, 60), np.uint8))
    told: list[str] = []
    got = truths(tmp_path, told)
    assert got == dict.fromkeys(["bad.jpg", "bad_mask.png", "empty.jpg", "other_size.png"], "unreadable") | {
        "good.png": None
    }
    assert len(told) == 4 and "bad.jpg" in told[0] and "masks" in told[1] and "60 x 48" in told[3]


def test_folders_are_named_so_that_they_differ(tmp_path: Path) -> None:
    paths = [tmp_path / "a" / "test", tmp_path / "b" / "test"]
    for path in paths:
        write(path / "images" / "x.png", grey())
    assert [folder.name for folder in image_folders(paths)] == [str(path) for path in paths]
    assert [folder.name for folder in image_folders(paths[:1])] == ["test"]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("image,cx,cy,w,h,kind\na,0.5,0.5,much,0.1,gt\n", "much"),
        ("image,cx,cy,w,h,kind\na,0.5,7.5,0.1,0.1,gt\n", "7.5"),
        ("image,cx,cy,w,h,kind\na,0.5\n", "line 2 has no kind"),
        ("stem,cx,cy,w,h,kind\na,0.5,0.5,0.1,0.1,gt\n", "line 2 has no image"),
    ],
)
def test_boxes_that_are_none_are_refused(tmp_path: Path, text: str, names: str) -> None:
    write(tmp_path / "images" / "a.png", grey())
    (tmp_path / "boxes.csv").write_text(text)
    with pytest.raises(ImageFolderError, match=names) as error:
        image_folders([tmp_path])
    assert "boxes.csv" in str(error.value)


@pytest.mark.skipif(not (DATA / "smoke_boreal_uav").is_dir(), reason="no shared data")
def test_real_folders() -> None:
    names = ("smoke_hpwren_smokeseg", "smoke_boreal_uav", "negatives_horizon_uav")
    got = [list(truths(DATA / name).values()) for name in names]
    assert [len(found) for found in got] == [19, 6, 29]
    assert [sum(isinstance(one, Truth) for one in found) for found in got] == [19, 5, 0]
    assert not any("unreadable" in found for found in got)


# The sheet


def test_outlines_lie_where_the_masks_are() -> None:
    image = grey(768, 576)  # twice a tile's size
    truth = block((200, 299, 100, 299), size=(576, 768))
    found = block((5, 8, 20, 29), size=(36, 48))  # 16 times coarser than the image
    picture = tile(image, truth, found, "name", "verdict")
    assert picture.shape == (328, 384, 3)
    for colour, (left, top, right, bottom) in ((TRUTH_BGR, (50, 100, 149, 149)), (FOUND_BGR, (160, 40, 239, 71))):
        rows, columns = np.nonzero((picture == colour).all(axis=2))
        got = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        assert got == pytest.approx(np.array([left, top, right, bottom]), abs=1.5)
    assert picture[288:].max() > 200 and image.max() == 90


def test_a_sheet_has_rows_of_five() -> None:
    tiles = [np.full((2, 3, 3), value, np.uint8) for value in range(1, 8)]
    page = sheet(tiles)
    assert page.shape == (4, 15, 3)
    assert page[2, 3, 0] == 7 and page[2, 6, 0] == 0
    assert sheet(tiles[:2]).shape == (2, 6, 3)


# The command


class Fake:
    """Calls a frame's red pixels smoke; counts its frames."""

    def __init__(self, camera: Camera) -> None:
        self.name = "fake"
        self.camera = camera
        self.frames = 0

    def segment(self, frame: Frame, pose: CameraPose | None) -> MaskArray | RejectReason:
        assert pose is None and frame.image is not None
        assert frame.image.shape[:2] == (self.camera.height, self.camera.width)
        self.frames += 1
        red = frame.image[..., 2] > 200
        return FLOODED if red.all() else np.where(red, 255, 0).astype(np.uint8)


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> list[Fake]:
    made: list[Fake] = []

    def make(config: SegmenterConfig, camera: Camera) -> Fake:
        made.append(Fake(camera))
        return made[-1]

    monkeypatch.setattr(study_segmentation, "make_segmenter", make)
    return made


def red(*sides: tuple[int, int, int, int], width: int = 64, height: int = 48) -> np.ndarray[Any, Any]:
    image = grey(width, height)
    image[block(*sides, size=(height, width))] = (0, 0, 255)
    return image


def read_json(out: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((out / "segmentation.json").read_text())
    return content


def read_csv(out: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((out / "segmentation.csv").read_text().splitlines()))


def test_one_segmenter_for_each_size_and_one_frame_to_warm_it(tmp_path: Path, fakes: list[Fake]) -> None:
    for stem, width in (("a", 64), ("b", 32), ("c", 64)):
        write(tmp_path / "in" / f"{stem}.png", grey(width))
    run_segmentation([tmp_path / "in"], "classical", None, tmp_path / "out", quiet)
    assert [(fake.camera.width, fake.camera.height, fake.frames) for fake in fakes] == [(64, 48, 3), (32, 48, 2)]
    assert fakes[0].camera.fx == 64.0 and fakes[0].camera.cx == 31.5


def test_files_agree_with_what_was_drawn(tmp_path: Path, fakes: list[Fake]) -> None:
    smoke = block((10, 19, 20, 29))
    for stem, image in (
        ("half", red((10, 19, 20, 24))),
        ("flooded", red((0, 47, 0, 63))),
        ("clean", grey()),
        ("false", red((0, 3, 0, 3))),
    ):
        write(tmp_path / "a" / "images" / f"{stem}.png", image)
    (tmp_path / "a" / "images" / "bad.png").write_bytes(b"no image")
    for stem in ("half", "flooded"):
        write(tmp_path / "a" / "masks" / f"{stem}.png", smoke.astype(np.uint8))
    write(tmp_path / "b" / "sky.png", red((0, 3, 0, 3), (30, 33, 0, 3)))
    told: list[str] = []
    run_segmentation([tmp_path / "a", tmp_path / "b"], "classical", None, tmp_path / "out", told.append)
    got = read_json(tmp_path / "out")
    folders = got.pop("folders")
    assert got.pop("ms_median") > 0.0
    assert got == {
        "segmenter": "fake",
        "smoke_images": 2,
        "negative_images": 3,
        "found_share": 0.5,
        "iou_mean": 0.25,
        "precision": 1.0,
        "recall": 0.25,
        "centroid_error_px_median": 2.5,
        "base_error_px_median": 2.5,
        "false_per_smoke_image": 0.0,
        "false_per_negative": 1.0,
        "rejected": {"segmentation_flooded": 1},
        "unreadable": 1,
    }
    assert [one["folder"] for one in folders] == ["a", "b"]
    assert folders[1]["found_share"] is None and folders[1]["iou_mean"] is None
    assert (folders[0]["false_per_negative"], folders[1]["false_per_negative"]) == (0.5, 2.0)
    rows = {row["image"]: row for row in read_csv(tmp_path / "out")}
    assert {name: row["kind"] for name, row in rows.items()} == {
        "bad.png": "unreadable",
        "clean.png": "negative",
        "false.png": "negative",
        "flooded.png": "smoke",
        "half.png": "smoke",
        "sky.png": "negative",
    }
    assert rows["half.png"]["iou"] == "0.5" and rows["half.png"]["found"] == "1"
    assert rows["flooded.png"]["rejected"] == "segmentation_flooded" and rows["flooded.png"]["found"] == "0"
    assert rows["sky.png"]["false_segments"] == "2" and rows["sky.png"]["found"] == ""
    picture = cv2.imread(str(tmp_path / "out" / "contact_sheet.png"))
    assert picture is not None and picture.shape == (328, 5 * 384, 3)
    assert len(told) == 3 and "bad.png" in told[0] and "1 segmentation_flooded, 1 unreadable" in told[1]


def test_many_images_fill_pages_and_an_earlier_sheet_goes(tmp_path: Path, fakes: list[Fake]) -> None:
    for number in range(41):
        write(tmp_path / "in" / f"{number:02}.png", red((0, 3, 0, 3)) if number == 7 else grey())
    out = tmp_path / "out"
    out.mkdir()
    (out / "contact_sheet.png").write_bytes(b"old")
    (out / "contact_sheet_mine.png").write_bytes(b"mine")
    run_segmentation([tmp_path / "in"], "classical", None, out, quiet)
    names = ["contact_sheet_1.png", "contact_sheet_2.png", "contact_sheet_mine.png"]
    assert sorted(path.name for path in out.glob("contact*")) == names
    last = cv2.imread(str(out / "contact_sheet_2.png"))
    assert last is not None and last.shape == (328, 384, 3)  # the worst alone
    assert (last == FOUND_BGR).all(axis=2).any()


def test_a_model_from_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = red_model(tmp_path / "red.onnx", CARD)
    write(tmp_path / "in" / "images" / "same.png", red((10, 29, 80, 99), width=128, height=64))
    write(tmp_path / "in" / "images" / "small.png", red((5, 14, 40, 49), width=64, height=32))
    write(tmp_path / "in" / "masks" / "same.png", block((10, 29, 80, 99), size=(64, 128)).astype(np.uint8))
    write(tmp_path / "in" / "masks" / "small.png", block((5, 14, 40, 49), size=(32, 64)).astype(np.uint8))
    run_segmentation([tmp_path / "in"], str(path), 0.4, tmp_path / "out", quiet)
    got = read_json(tmp_path / "out")
    assert got["segmenter"].startswith("onnx red") and got["found_share"] == 1.0 and got["iou_mean"] == 1.0
    assert got["centroid_error_px_median"] == 0.0 and got["base_error_px_median"] == 0.0
    monkeypatch.setattr(study_segmentation, "shipped_model", lambda: path)
    run_segmentation([tmp_path / "in"], "onnx", None, tmp_path / "shipped", quiet)
    assert read_json(tmp_path / "shipped")["iou_mean"] == 1.0


def test_the_classical_segmenter_on_rendered_frames(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = Camera(640, 360, 450.0, 450.0, 320.0, 180.0)
    R = R_cam_from_enu(matrix_from_euler(0.0, np.radians(-5.0), 0.0), np.eye(3))
    pose = CameraPose(60.0, np.array([0.0, 0.0, 120.0]), R)
    plume = Plume(np.array([0.0, 1500.0, 0.0]), 160.0, 120.0, np.array([2.0, 0.0, 0.0]))
    folder = tmp_path / "rendered"
    for seed in range(3):
        image, mask = Renderer(camera, [plume] if seed < 2 else [], np.random.default_rng(seed)).render(pose)
        write(folder / "images" / f"{seed}.png", image)
        write(folder / "masks" / f"{seed}.png", mask)
    out = tmp_path / "out"
    arguments = ["study", "segmentation", str(folder), "--segmenter", "classical", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", ["distloc", *arguments])
    with pytest.raises(SystemExit) as exit_:
        main()
    assert not exit_.value.code
    table = capfd.readouterr().out
    assert "rendered" in table and "all" in table and str(out) in table
    got = read_json(out)
    assert (got["segmenter"], got["smoke_images"], got["negative_images"]) == ("classical", 2, 1)
    rows = read_csv(out)
    assert [(row["image"], row["kind"]) for row in rows] == [
        ("0.png", "smoke"),
        ("1.png", "smoke"),
        ("2.png", "negative"),
    ]
    assert got["iou_mean"] == pytest.approx(np.mean([float(row["iou"]) for row in rows[:2]]), abs=1e-4)
    assert got["ms_median"] == pytest.approx(np.median([float(row["ms"]) for row in rows]), abs=1e-3)
    assert cv2.imread(str(out / "contact_sheet.png")) is not None


@pytest.mark.parametrize(
    ("arguments", "code", "names"),
    [
        (["gone"], 1, "gone: no such folder"),
        (["empty"], 1, "no images"),
        (["good", "gone"], 1, "gone: no such folder"),
        (["good", "--segmenter", "yolo"], 78, "--segmenter is 'yolo'"),
        (["good", "--segmenter", "nope.onnx"], 78, "nope.onnx"),
        (["good", "--segmenter", "classical", "--threshold", "1.5"], 78, "--threshold is 1.5"),
        (["good", "--segmenter", "classical", "--threshold", "nan"], 78, "--threshold is nan"),
        (["good", "--segmenter", "classical", "--out", "good/a.png"], 1, "--out"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    code: int,
    names: str,
) -> None:
    write(tmp_path / "good" / "a.png", grey())
    (tmp_path / "empty" / "images").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["distloc", "study", "segmentation", *arguments])
    with pytest.raises(SystemExit) as exit_:
        main()
    lines = capfd.readouterr().err.splitlines()
    assert exit_.value.code == code and len(lines) == 1
    assert lines[0].startswith("distloc: ") and names in lines[0]
    assert not list(tmp_path.rglob("segmentation.*"))


def test_nothing_readable_still_counts(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "bad.png").write_bytes(b"no image")
    run_segmentation([tmp_path / "in"], "sobel", None, tmp_path / "out", quiet)
    got = read_json(tmp_path / "out")
    assert (got["segmenter"], got["unreadable"], got["smoke_images"], got["ms_median"]) == ("sobel", 1, 0, None)
    assert [row["kind"] for row in read_csv(tmp_path / "out")] == ["unreadable"]
    assert not list((tmp_path / "out").glob("*.png"))


def test_a_threshold_goes_to_the_model(tmp_path: Path) -> None:
    path = red_model(tmp_path / "red.onnx", CARD)
    write(tmp_path / "in" / "a.png", np.full((64, 128, 3), 130, np.uint8))  # the probability is 0.55 everywhere
    for threshold, refused in ((0.5, {"segmentation_flooded": 1}), (0.7, {})):
        run_segmentation([tmp_path / "in"], str(path), threshold, tmp_path / "out", quiet)
        assert read_json(tmp_path / "out")["rejected"] == refused
    with pytest.raises(ConfigError, match="threshold"):
        run_segmentation([tmp_path / "in"], str(path), 0.0, tmp_path / "out", quiet)


def test_an_exported_detector_goes_through_as_it_is_and_the_config_says_the_rest(tmp_path: Path) -> None:
    metadata = {"task": "detect", "imgsz": "[64, 64]", "names": "{0: 'haze'}"}
    table = np.array([[32.0, 32.0, 16.0, 16.0, 0.6], *[[20.0, 20.0, 9.0, 9.0, 0.0]] * 20])[None].transpose(0, 2, 1)
    path = exported_model(tmp_path / "yolo.onnx", metadata, table, shape=(1, 3, 64, 64))
    write(tmp_path / "in" / "images" / "a.png", grey(128, 128))
    write(tmp_path / "in" / "masks" / "a.png", block((48, 79, 48, 79), size=(128, 128)).astype(np.uint8) * 255)
    with pytest.raises(ConfigError, match=r"lacks distloc\.smoke_class; .*its classes are 'haze'"):
        run_segmentation([tmp_path / "in"], str(path), None, tmp_path / "out", quiet)
    config = tmp_path / "config.toml"
    config.write_text('[segmenter.preprocessing]\nsmoke_class = "haze"\n')
    run_segmentation([tmp_path / "in"], str(path), None, tmp_path / "out", quiet, config)
    assert read_json(tmp_path / "out")["iou_mean"] == 1.0


def test_another_kind_of_model_is_named(tmp_path: Path) -> None:
    write(tmp_path / "in" / "a.png", grey())
    (tmp_path / "a.tflite").write_bytes(b"\x1c\0\0\0TFL3")
    with pytest.raises(ConfigError, match=r"a\.tflite': a TFLite model; only ONNX is run"):
        run_segmentation([tmp_path / "in"], str(tmp_path / "a.tflite"), None, tmp_path / "out", quiet)
