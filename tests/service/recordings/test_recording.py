import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.recordings.recording import Recording, RecordingError
from tests.support.places import SITL

PLACE = {"lat": 38.7, "lon": -0.6, "alt_msl_m": 871.0}


def folder(tmp_path: Path, rows: str = "") -> Path:
    (tmp_path / "telemetry.tlog").write_bytes(b"\0" * 20)
    if rows:
        (tmp_path / "frames.csv").write_text("stamp_us,file\n" + rows)
    return tmp_path


def test_frames_are_sorted_and_bad_rows_counted(tmp_path: Path) -> None:
    rows = "200,00002\n100,00001\nx,00003\n-5,a\n300\n400,../secret\n100,again\n99999999999999999999,a\n\n"
    recording = Recording(folder(tmp_path, rows))
    assert recording.frames() == [(100, "00001"), (200, "00002")]
    assert recording.dropped == {"bad_stamp": 3, "short_row": 2, "bad_name": 1, "repeated_stamp": 1}
    assert recording.load_image("00001") is None


def test_images_are_found_with_and_without_suffix(tmp_path: Path) -> None:
    path = folder(tmp_path, "100,00001\n")
    (path / "frames").mkdir()
    cv2.imwrite(str(path / "frames" / "00001.png"), np.full((4, 6, 3), 77, np.uint8))
    (path / "frames" / "bad.png").write_bytes(b"no image")
    recording = Recording(path)
    for name in ("00001", "00001.png"):
        image = recording.load_image(name)
        assert image is not None and image.shape == (4, 6, 3) and (image == 77).all()
    assert recording.load_image("bad") is None
    assert recording.load_image("../frames/00001") is None


def test_a_video_is_read_by_number_in_any_order(tmp_path: Path) -> None:
    path = folder(tmp_path, "100,0\n200,1\n")
    writer = cv2.VideoWriter(str(path / "video.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (64, 48))
    for level in range(0, 200, 20):
        writer.write(np.full((48, 64, 3), level, np.uint8))
    writer.release()
    recording = Recording(path)
    for number in (0, 1, 7, 2, 3):
        image = recording.load_image(str(number))
        assert image is not None and abs(float(image.mean()) - 20.0 * number) < 6.0
    assert recording.load_image("99") is None and recording.load_image("x") is None
    recording.close()


def test_truth_and_config(tmp_path: Path) -> None:
    path = folder(tmp_path)
    assert Recording(path).truth is None and Recording(path).config_path is None
    (path / "truth.json").write_text(json.dumps({"targets": [{"centre": PLACE, "base": PLACE, "size_m": 120.0}]}))
    (path / "config.toml").write_text("")
    recording = Recording(path)
    assert recording.truth is not None and recording.truth.targets[0].centre.lat == 38.7
    assert recording.config_path == path / "config.toml"
    (path / "truth.json").write_text('{"targets": 3}')
    with pytest.raises(RecordingError, match=r"truth\.json"):
        Recording(path)


def test_a_bare_log_and_unreadable_ones(tmp_path: Path) -> None:
    log = tmp_path / "a.tlog"
    with pytest.raises(RecordingError, match="no such file"):
        Recording(log)
    log.write_bytes(b"")
    with pytest.raises(RecordingError, match="empty"):
        Recording(log)
    log.write_bytes(b"1")
    assert Recording(log).frames() == [] and Recording(log).tlog_path == log
    with pytest.raises(RecordingError, match=r"telemetry\.tlog"):
        Recording(tmp_path)
    (folder(tmp_path) / "frames.csv").write_text("time,name\n")
    with pytest.raises(RecordingError, match="header"):
        Recording(tmp_path)


def test_a_real_recording() -> None:
    path = SITL / "copter_nominal"
    if not path.exists():
        pytest.skip("no recordings beside the repository")
    recording = Recording(path)
    assert len(recording.frames()) > 50 and not recording.dropped
    assert recording.truth is not None and recording.truth.targets[0].size_m == 120.0
