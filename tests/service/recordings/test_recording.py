import json
import os
import re
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.common.files import FileRefusedError
from service.recordings.recording import Recording, RecordingError
from tests.support.places import SITL

PLACE = {"lat": 38.7, "lon": -0.6, "alt_msl_m": 871.0}


def folder(tmp_path: Path, rows: str = "") -> Path:
    tmp_path.mkdir(exist_ok=True)
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


@pytest.mark.parametrize(
    "table",
    [
        b"\xef\xbb\xbfstamp_us,file\r\n100,a\r\n200,b\r\n",
        b"stamp_us,frame\n100,a\n200,b\n",
        b"stamp_us,file\n100,frames/a\n200,masks/b\n",
        b"stamp_us,file\n100,./frames/a\n200,frames\\b\n",
        b"exposure_us,stamp_us,file\n7,100,a\n7,200,b\n",
        b'stamp_us,file\n100,a\n150,"no end\n200,b\n',
    ],
    ids=["mark and CRLF", "frame", "folders", "dots and backslashes", "another column", "an open quote"],
)
def test_tables_as_programs_write_them(tmp_path: Path, table: bytes) -> None:
    path = folder(tmp_path)
    (path / "frames.csv").write_bytes(table)
    recording = Recording(path)
    assert [row for row in recording.frames() if row[0] != 150] == [(100, "a"), (200, "b")]
    assert not recording.dropped


def test_a_line_without_an_end_costs_one_row(tmp_path: Path) -> None:
    recording = Recording(folder(tmp_path, "100,a\n" + "1" * 3_000_000 + "\n200,b\n300," + "c" * 3_000_000))
    assert recording.frames() == [(100, "a"), (200, "b")] and recording.dropped == {"long_row": 2}


@pytest.mark.parametrize("name", ["frames.csv", "truth.json", "config.toml", "telemetry.tlog"])
@pytest.mark.parametrize("kind", ["pipe", "device", "link out", "ring", "folder"])
def test_what_is_no_file_of_the_folder_is_refused(tmp_path: Path, name: str, kind: str) -> None:
    path = folder(tmp_path / "made")
    odd = path / name
    odd.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(odd)
    elif kind == "folder":
        odd.mkdir()
    else:
        (tmp_path / "outside").write_text("secret")
        odd.symlink_to({"device": "/dev/zero", "link out": tmp_path / "outside", "ring": odd}[kind])
    with pytest.raises(RecordingError, match=re.escape(str(odd))):
        assert Recording(path).config_path


def test_files_too_large_are_refused_unread(tmp_path: Path) -> None:
    path = folder(tmp_path)
    for name in ("truth.json", "frames.csv"):
        with (path / name).open("wb") as file:
            file.truncate(10**12)
        with pytest.raises(RecordingError, match=rf"{name}: has 1000000000000 bytes, more than"):
            Recording(path)
        (path / name).unlink()


def test_pictures_are_refused_by_kind_place_and_header(tmp_path: Path) -> None:
    path = folder(tmp_path / "made", "".join(f"{number},{number}\n" for number in range(1, 6)))
    frames = path / "frames"
    frames.mkdir()
    image = np.full((4, 6, 3), 77, np.uint8)
    cv2.imwrite(str(tmp_path / "outside.png"), image)
    (frames / "1.png").symlink_to(tmp_path / "outside.png")
    (frames / "2.png").symlink_to("/dev/zero")
    os.mkfifo(frames / "3.png")
    huge = bytearray(cv2.imencode(".png", image)[1].tobytes())
    huge[16:24] = struct.pack(">II", 32_000, 32_000)
    (frames / "4.png").write_bytes(huge)
    cv2.imwrite(str(frames / "5.png"), image)
    recording = Recording(path)
    for name in "1234":
        with pytest.raises(FileRefusedError, match=rf"frames/{name}\.png"):
            recording.load_image(name)
    with pytest.raises(FileRefusedError, match="6 x 4 pixels, more than 23"):
        recording.load_image("5", 23)
    assert recording.load_image("5", 24) is not None
    frames.rename(tmp_path / "frames")
    frames.symlink_to(tmp_path / "frames")
    with pytest.raises(RecordingError, match="leads out of"):
        recording.load_image("5")


def test_a_real_recording() -> None:
    path = SITL / "copter_nominal"
    if not path.exists():
        pytest.skip("no recordings beside the repository")
    recording = Recording(path)
    assert len(recording.frames()) > 50 and not recording.dropped
    assert recording.truth is not None and recording.truth.targets[0].size_m == 120.0
