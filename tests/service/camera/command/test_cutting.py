"""What a command writes is cut into the same pictures however the bytes come."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from service.camera.command.cutting import Cutter, cutter_of
from service.camera.command.pictures import Encoded, FormatError, Jpeg, PictureError, Planes

SIZE = (32, 16)
PIXELS = SIZE[0] * SIZE[1]
RNG = np.random.default_rng(0)


def picture(number: int) -> NDArray[np.uint8]:
    return np.clip(RNG.normal(40.0 * number + 20.0, 8.0, (SIZE[1], SIZE[0], 3)), 0, 255).astype(np.uint8)


def jpeg(number: int, progressive: bool = False, with_thumbnail: bool = False) -> bytes:
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive), cv2.IMWRITE_JPEG_RST_INTERVAL, 2]
    data = cv2.imencode(".jpg", picture(number), options)[1].tobytes()
    if not with_thumbnail:
        return data
    inner = jpeg(0)
    return data[:2] + b"\xff\xe1" + (len(inner) + 2).to_bytes(2, "big") + inner + data[2:]


def y4m(count: int) -> bytes:
    head = b"YUV4MPEG2 W32 H16 F30:1 Ip A1:1 C420jpeg\n"
    return head + b"".join(b"FRAME\n" + bytes([number]) * (PIXELS * 3 // 2) for number in range(count))


def raw(count: int) -> bytes:
    return b"".join(bytes([number]) * (PIXELS * 3) for number in range(count))


def boundary(data: bytes) -> bytes:
    return b"--x\r\nContent-Type: image/jpeg\r\n\r\n" + data + b"\r\n"


JPEGS = [jpeg(1), jpeg(2, progressive=True), jpeg(3, with_thumbnail=True)]
STREAMS = {
    "bgr": raw(3),
    "y4m": y4m(3),
    "mjpeg": b"".join(JPEGS),
    "mjpeg of parts": b"".join(boundary(one) for one in JPEGS),
    "mjpeg begun in the midst": JPEGS[0][30:] + b"".join(JPEGS),
}


def cutter(name: str) -> Cutter:
    return cutter_of(name.partition(" ")[0], SIZE, PIXELS)


def cut(cutter: Cutter, data: bytes, at: list[int]) -> list[Encoded]:
    bounds = [0, *sorted(at), len(data)]
    return [one for start, end in pairwise(bounds) for one in cutter.feed(memoryview(data)[start:end])]


def content(one: Encoded) -> bytes:
    assert isinstance(one, (Jpeg, Planes))
    return bytes(one.data)


@pytest.mark.parametrize("name", STREAMS)
def test_the_pictures_that_were_written(name: str) -> None:
    found = [content(one) for one in cut(cutter(name), STREAMS[name], [])]
    if name.startswith("mjpeg"):
        assert found == JPEGS
    else:
        assert [set(one) for one in found] == [{0}, {1}, {2}]


@pytest.mark.parametrize("name", STREAMS)
@given(data=st.data())
def test_wherever_the_bytes_are_parted(name: str, data: st.DataObject) -> None:
    stream = STREAMS[name]
    at = data.draw(st.lists(st.integers(0, len(stream)), max_size=20))
    whole = [content(one) for one in cut(cutter(name), stream, [])]
    assert [content(one) for one in cut(cutter(name), stream, at)] == whole


@pytest.mark.parametrize("name", STREAMS)
def test_byte_by_byte(name: str) -> None:
    stream, cutting = STREAMS[name], cutter(name)
    assert len(cut(cutting, stream, list(range(1, len(stream))))) == 3
    assert cutting.held == 0


def test_one_that_another_interrupts_is_given_cut_short() -> None:
    found = cut(cutter("mjpeg"), JPEGS[0][:-40] + JPEGS[1], [])
    assert [content(one) for one in found] == [JPEGS[0][:-40], JPEGS[1]]
    with pytest.raises(PictureError, match="a JPEG is cut short"):
        found[0].decoded(0)
    assert found[1].decoded(0).shape == (16, 32, 3)


@given(junk=st.binary(max_size=2000))
def test_junk_is_no_fault_of_ours(junk: bytes) -> None:
    for name in ("bgr", "y4m", "mjpeg"):
        cutting = cutter(name)
        try:
            for one in cut(cutting, junk, [len(junk) // 2]):
                assert one.decoded(0).shape == (one.size_px[1], one.size_px[0], 3)
        except (FormatError, PictureError):
            pass
        assert cutting.held <= len(junk)


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("mjpeg", bytes(300_000), "writes bytes that are no JPEG of over 132608 bytes: is its output MJPEG"),
        ("mjpeg", JPEGS[0][:-2] + bytes(300_000), "writes one JPEG of over 132608 bytes"),
        ("y4m", b"\xff\xd8\xff\xe0", r"does not write Y4M: b'\\xff\\xd8\\xff\\xe0' stands where YUV4MPEG2 should"),
        ("y4m", b"YUV4MPEG2 W32 H16\nFRAMX", "stands where FRAME should"),
        ("y4m", b"YUV4MPEG2 " + b"X" * 2000, "does not write Y4M"),
        ("y4m", b"YUV4MPEG2 W32 H16 C444\n", "of the format C444: it must be 4:2:0 of 8 bits"),
        ("y4m", b"YUV4MPEG2 W32 H16 C420p10\n", "of the format C420p10: it must be 4:2:0 of 8 bits"),
        ("y4m", b"YUV4MPEG2 H16 F30:1\n", "header without width and height"),
        ("y4m", b"YUV4MPEG2 W31 H16\n", "31 x 16: both must be even, and some"),
        ("y4m", b"YUV4MPEG2 W99999999999999 H99999999\n", "more pixels than camera.width, camera.height"),
        ("y4m", b"YUV4MPEG2 W0 H0\n", "writes Y4M of 0 x 0"),
    ],
)
def test_what_cannot_go_on_is_said(name: str, data: bytes, said: str) -> None:
    cutting = cutter(name)
    with pytest.raises(FormatError, match=said):
        for start in range(0, len(data), 1000):
            list(cutting.feed(memoryview(data)[start : start + 1000]))


@pytest.mark.parametrize("name", ["mjpeg", "bgr"])
def test_no_more_is_held_than_one_picture(name: str) -> None:
    cutting, stream, most = cutter(name), STREAMS[name] * 100, 0
    for start in range(0, len(stream), 700):
        list(cutting.feed(memoryview(stream)[start : start + 700]))
        most = max(most, cutting.held)
    assert 700 < most <= max(len(one) for one in JPEGS) + 700
