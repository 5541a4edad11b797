import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.renderer import Plume, Renderer
from distloc.types import CameraPose, RejectReason
from service.common.messages import Frame
from service.config.sections import ConfigError, SegmenterConfig
from service.segmenters.segment import ClassicalSegmenter, RecordedSegmenter, SobelSegmenter, make_segmenter

CAMERA = Camera(1280, 720, 900.0, 900.0, 640.0, 360.0)
R = R_cam_from_enu(matrix_from_euler(0.1, np.radians(-5.0), 0.03), np.eye(3))
POSE = CameraPose(60.0, np.array([0.0, 0.0, 120.0]), R)


def test_rendered_smoke_is_found_and_a_landscape_without_is_left_alone() -> None:
    segmenter = ClassicalSegmenter(CAMERA, 0.3)
    overlaps = []
    for seed, north_m in enumerate((1500.0, 2000.0, 2000.0, 2500.0, 3000.0)):
        plume = Plume(np.array([100.0 * seed, north_m, 0.0]), 160.0, 120.0, np.array([2.0, 0.0, 0.0]))
        image, truth = Renderer(CAMERA, [plume], np.random.default_rng(seed)).render(POSE)
        mask = segmenter.segment(Frame(0, "a", image), POSE)
        assert not isinstance(mask, RejectReason) and mask.shape == (360, 640)
        full = cv2.resize(mask, (1280, 720), interpolation=cv2.INTER_NEAREST) > 0
        overlaps.append((full & (truth > 0)).sum() / (full | (truth > 0)).sum())
        empty, _ = Renderer(CAMERA, [], np.random.default_rng(seed)).render(POSE)
        none = segmenter.segment(Frame(0, "b", empty), POSE)
        assert not isinstance(none, RejectReason) and not none.any()
    assert sum(overlap > 0.4 for overlap in overlaps) >= 4


def test_classical_never_floods_and_needs_an_image() -> None:
    segmenter = ClassicalSegmenter(CAMERA, 0.001)
    plume = Plume(np.array([0.0, 1000.0, 0.0]), 160.0, 120.0, np.zeros(3))
    image, _ = Renderer(CAMERA, [plume], np.random.default_rng(0)).render(POSE)
    assert segmenter.segment(Frame(0, "a", image), POSE) is RejectReason.SEGMENTATION_FLOODED
    assert segmenter.segment(Frame(0, "a", None), POSE) is RejectReason.BAD_FRAME


def test_sobel_finds_a_thin_mast() -> None:
    image = np.full((720, 1280, 3), 200, np.uint8)
    image[200:500, 600:603] = 20
    image[600:603] = 20
    mask = SobelSegmenter(CAMERA).segment(Frame(0, "a", image), None)
    assert not isinstance(mask, RejectReason)
    rows, columns = np.nonzero(mask)
    assert columns.mean() == pytest.approx(601.0, abs=1.0) and rows.mean() == pytest.approx(349.5, abs=2.0)


def recorded(folder: Path, masks: dict[str, NDArray[np.uint8]]) -> RecordedSegmenter:
    """The segmenter of a recording with these masks."""
    (folder / "masks").mkdir(exist_ok=True)
    for name, mask in masks.items():
        cv2.imwrite(str(folder / "masks" / f"{name}.png"), mask)
    segmenter = make_segmenter(SegmenterConfig(kind="recorded"), CAMERA, folder)
    assert isinstance(segmenter, RecordedSegmenter)
    return segmenter


def mask_of(segmenter: RecordedSegmenter, name: str) -> NDArray[np.uint8]:
    mask = segmenter.segment(Frame(0, name, None), None)
    assert not isinstance(mask, RejectReason), mask
    return mask


def test_recorded_masks(tmp_path: Path) -> None:
    step = np.tri(9, 16, dtype=np.uint8)
    segmenter = recorded(tmp_path, {"00001": step * 200, "00004": step[:, :7], "00005": step * 100})
    (tmp_path / "masks" / "00002.png").write_bytes(b"no image")
    assert np.array_equal(mask_of(segmenter, "00001.jpg"), step * 255)
    assert segmenter.segment(Frame(0, "00002", None), None) is RejectReason.BAD_FRAME
    assert segmenter.segment(Frame(0, "00003", None), None) is RejectReason.FRAME_MISSING
    assert segmenter.segment(Frame(0, "00004", None), None) is RejectReason.BAD_FRAME
    assert segmenter.faint == 0
    assert not mask_of(segmenter, "00005").any() and segmenter.faint == 1


def test_masks_of_0_and_1_are_masks(tmp_path: Path) -> None:
    step = np.tri(9, 16, dtype=np.uint8)
    segmenter = recorded(tmp_path, {"00000": step * 0, "00001": step})
    assert np.array_equal(mask_of(segmenter, "00001"), step * 255) and not mask_of(segmenter, "00000").any()
    segmenter = recorded(tmp_path, {"00002": step * 255})  # then 1 of 255 is no smoke
    assert not mask_of(segmenter, "00001").any() and segmenter.faint == 1


@pytest.mark.parametrize("most", [1, 255, 65_535])
def test_masks_of_16_bits(tmp_path: Path, most: int) -> None:
    step = np.tri(9, 16, dtype=np.uint16)
    (tmp_path / "masks").mkdir()
    cv2.imwrite(str(tmp_path / "masks" / "00001.png"), step * most)
    assert np.array_equal(mask_of(recorded(tmp_path, {}), "00001"), step * 255)


@pytest.mark.parametrize("kind", ["pipe", "device", "link out"])
def test_a_mask_that_is_no_file_of_the_folder_is_one_bad_frame(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "made"
    folder.mkdir()
    segmenter = recorded(folder, {"00001": np.tri(9, 16, dtype=np.uint8) * 255})
    odd = folder / "masks" / "00002.png"
    if kind == "pipe":
        os.mkfifo(odd)
    else:
        outside = (folder / "masks" / "00001.png").rename(tmp_path / "outside.png")
        odd.symlink_to("/dev/zero" if kind == "device" else outside)
    assert segmenter.segment(Frame(0, "00002", None), None) is RejectReason.BAD_FRAME


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"segmenter\.model.*gone\.onnx"):
        make_segmenter(SegmenterConfig(kind="onnx", model="gone.onnx"), CAMERA)
    with pytest.raises(ConfigError, match=r"segmenter\.kind"):
        make_segmenter(SegmenterConfig(kind="recorded"), CAMERA, tmp_path)
