import random
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.camera.sources import CaptureSource, FolderSource, SizeError, SourceError, VideoSource, open_source
from service.config.sections import SourceConfig
from tests.support.odd_pictures import REFUSED, huge_png

CAMERA = Camera(128, 96, 100.0, 100.0, 64.0, 48.0)


class FakeCapture:
    def __init__(self, frames: int, is_open: bool = True) -> None:
        self.left, self.is_open = frames, is_open

    def isOpened(self) -> bool:
        return self.is_open

    def grab(self) -> bool:
        self.left -= 1
        return self.left >= 0

    def retrieve(self) -> tuple[bool, np.ndarray]:
        return True, np.zeros((48, 64, 3), np.uint8)

    def release(self) -> None:
        self.is_open = False


def test_a_folder_is_read_in_order_and_bad_files_are_counted(tmp_path: Path) -> None:
    for name, size in (("b.png", (64, 48)), ("a.png", (128, 96)), ("d.png", (60, 48))):
        cv2.imwrite(str(tmp_path / name), np.zeros((size[1], size[0], 3), np.uint8))
    (tmp_path / "c.png").write_bytes(b"no image")
    with FolderSource(tmp_path, 5.0, lambda: 1000, CAMERA) as source:
        frames = [source.read() for _ in range(3)]
    assert [(f.name, f.stamp_ns) for f in frames if f] == [("a.png", 1000), ("b.png", 200_001_000)]
    assert source.rejected == {RejectReason.BAD_FRAME: 2}


def test_a_wrong_size_at_the_first_frame_is_an_error(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((50, 60, 3), np.uint8))
    source = open_source(SourceConfig(kind="folder", path=str(tmp_path)), CAMERA, lambda: 0)
    with pytest.raises(SourceError, match=r"128 x 96.*60 x 50"):
        source.read()


def test_odd_pictures_of_a_folder_are_counted_each(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name, (suffix, made, _) in REFUSED.items():
        (tmp_path / f"b {name}{suffix}").write_bytes(made())
    for name in ("a.png", "c.png"):
        cv2.imwrite(str(tmp_path / name), np.zeros((96, 128, 3), np.uint8))
    with FolderSource(tmp_path, 5.0, lambda: 0, CAMERA) as source:
        assert [frame.name for frame in iter(source.read, None)] == ["a.png", "c.png"]
    assert source.rejected == {RejectReason.BAD_FRAME: len(REFUSED)}
    assert len(caplog.messages) == 1 and "from now on such frames are only counted" in caplog.messages[0]


def test_a_first_picture_larger_than_the_camera_is_told_by_its_header(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.png").write_bytes(huge_png())
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(SizeError, match=r"128 x 96: the source gives 32000 x 32000"):
        FolderSource(tmp_path, 5.0, lambda: 0, CAMERA).read()


@pytest.mark.parametrize("image", [np.zeros((48, 64), np.uint8), np.zeros((48, 64, 3), np.uint16)])
def test_what_a_camera_gives_beside_bgr_of_8_bits_is_counted(image: np.ndarray) -> None:
    odd, good = FakeCapture(1), FakeCapture(1)
    odd.retrieve = lambda: (True, image)  # type: ignore[method-assign]
    captures = iter([odd, good])
    source = CaptureSource("rtsp://x", 0, lambda: 0, CAMERA, lambda _: next(captures), lambda _: False)  # type: ignore[arg-type, return-value]
    assert source.read() is not None and source.rejected == {RejectReason.BAD_FRAME: 1}


def test_a_video_is_thinned_to_the_rate(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (64, 48))
    for _ in range(10):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    with VideoSource(path, 5.0, lambda: 7, CAMERA) as source:
        stamps = [frame.stamp_ns for frame in iter(source.read, None)]
    assert stamps == [7 + 200_000_000 * k for k in range(5)]


@pytest.mark.parametrize("kind", ["folder", "video", "v4l2"])
def test_what_is_missing_is_named(kind: str, tmp_path: Path) -> None:
    path = str(tmp_path / "gone")
    with pytest.raises(SourceError, match=r"camera\.source\.path is .*gone: no such"):
        open_source(SourceConfig(kind=kind, path=path), CAMERA, lambda: 0)  # type: ignore[arg-type]


def test_no_source_ends_at_once() -> None:
    assert open_source(SourceConfig(), CAMERA, lambda: 0).read() is None


def test_a_lost_camera_comes_back_after_growing_capped_delays() -> None:
    captures = iter([FakeCapture(1), *[FakeCapture(0, False) for _ in range(8)], FakeCapture(1)])
    delays: list[float] = []

    def wait(delay_s: float) -> bool:
        delays.append(delay_s)
        return False

    source = CaptureSource("rtsp://x", 5, lambda: 100, CAMERA, lambda _: next(captures), wait, random.Random(1))  # type: ignore[arg-type, return-value]
    first, second = source.read(), source.read()
    assert first and second and first.stamp_ns == 95
    assert source.reconnects == len(delays) == 9
    assert 0.25 <= delays[0] <= 0.5 and 1.25 <= delays[-1] <= 2.5
    source.close()
    assert source.read() is None


def test_a_camera_that_is_awaited_may_be_missing_at_first() -> None:
    captures = iter([FakeCapture(0, False), FakeCapture(0, False), FakeCapture(1)])
    source = CaptureSource(
        "/dev/none",
        5,
        lambda: 100,
        CAMERA,
        lambda _: next(captures),
        lambda _: False,
        is_awaited=True,  # type: ignore[arg-type, return-value]
    )
    frame = source.read()
    assert frame and frame.stamp_ns == 95 and source.reconnects == 2
    source.close()
