"""A recording's pictures and masks that are not what they should be: counted, refused in a line, or turned alike."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.camera import Camera
from service.common.image_header import turned
from service.common.messages import Frame
from service.config.load import load_config
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording, RecordingError
from service.segmenters.segment import RecordedSegmenter
from tests.support.odd_pictures import REFUSED, scene, with_orientation
from tests.support.places import CUT


def test_odd_pictures_are_counted_each(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    copy = Path(shutil.copytree(CUT, tmp_path / "copy"))
    (copy / "frames").mkdir()
    names = [line.split(",")[1] for line in (copy / "frames.csv").read_text().splitlines()[61:]]
    odd = [one for one in REFUSED.values() if one[0] in (".jpg", ".png")]  # the table's names have no suffix
    for name, (suffix, made, _) in zip(names, odd, strict=False):
        (copy / "frames" / f"{name}{suffix}").write_bytes(made())
    posed = PosedFrames(Recording(copy), load_config(copy / "config.toml"))
    assert sum(1 for _ in posed.pairs(lambda stamp_ns: None)) > 50
    assert posed.gate.rejects["bad_frame"] == len(odd)  # type: ignore[index]
    assert len(caplog.messages) == 1 and "a frame is not used" in caplog.messages[0]


def test_masks_of_which_none_is_a_frames_are_an_error(tmp_path: Path) -> None:
    copy = Path(shutil.copytree(CUT, tmp_path / "copy"))
    for mask in (copy / "masks").iterdir():
        mask.rename(mask.with_name(f"mask_{mask.name}"))
    config = load_config(copy / "config.toml")
    assert config.segmenter.kind == "recorded"
    with pytest.raises(RecordingError, match=r"masks: none of its \d+ files \(mask_.* is the mask of an image"):
        PosedFrames(Recording(copy), config)


def test_a_frames_mask_is_turned_with_it(tmp_path: Path) -> None:
    raw = np.zeros((48, 64), np.uint8)
    raw[5:20, 8:30] = 255
    (tmp_path / "frames").mkdir()
    (tmp_path / "masks").mkdir()
    (tmp_path / "telemetry.tlog").write_bytes(b"1")
    (tmp_path / "frames" / "1.jpg").write_bytes(with_orientation(scene(64, 48), "JPEG", 8))
    cv2.imwrite(str(tmp_path / "masks" / "1.png"), raw)
    picture = Recording(tmp_path).load_picture("1")
    assert picture is not None
    segmenter = RecordedSegmenter(tmp_path / "masks", Camera(48, 64, 50.0, 50.0, 24.0, 32.0))
    mask = segmenter.segment(Frame(0, "1", picture.image, picture.orientation), None)
    assert isinstance(mask, np.ndarray) and np.array_equal(mask, turned(raw, 8))
