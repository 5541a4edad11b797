"""Image files of every sort: turned upright, or refused in one line, by the header where that says enough."""

import io
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps

from service.common.files import FileRefusedError, TooLargeError, read_image, read_picture
from service.common.image_header import fault_of, orientation_of
from tests.support.odd_pictures import KINDS, REFUSED, huge_png, saved, scene, with_orientation


def written(folder: Path, name: str, data: bytes) -> Path:
    (folder / name).write_bytes(data)
    return folder / name


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_single_whole_picture_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    suffix, made, words = REFUSED[name]
    path = written(tmp_path, f"a{suffix}", made())
    with pytest.raises(FileRefusedError, match=words) as refused:
        read_picture(path)
    assert str(refused.value).startswith(f"{path}: ") and "\n" not in str(refused.value)
    assert read_image(path) is None


def test_a_huge_picture_is_not_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def imdecode(*_: object) -> None:
        raise AssertionError("it was decoded")

    monkeypatch.setattr(cv2, "imdecode", imdecode)
    data = huge_png()
    assert 3_000_000 <= len(data) < 3_100_000
    with pytest.raises(TooLargeError) as refused:
        read_picture(written(tmp_path, "a.png", data))
    assert refused.value.size_px == (32_000, 32_000)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 0.999])
def test_wherever_it_is_cut_it_is_refused_before_it_is_decoded(kind: str, share: float) -> None:
    whole = saved(scene(640, 480), kind)
    assert fault_of(whole) == "" and fault_of(whole[: int(share * len(whole))]) != ""


def test_what_follows_a_whole_jpeg_does_no_harm(tmp_path: Path) -> None:
    assert read_image(written(tmp_path, "a.jpg", saved(scene(), "JPEG") + bytes(5000))) is not None


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_of_16_bits_the_upper_half_counts(tmp_path: Path, suffix: str) -> None:
    image = scene()
    for values in (image.astype(np.uint16) * 257, image.astype(np.uint16)):  # of all 16 bits, of no more than 8
        data = cv2.imencode(suffix, values)[1].tobytes()
        assert np.array_equal(read_picture(written(tmp_path, f"a{suffix}", data)).image, image)


def test_grey_and_alpha_become_three_colours(tmp_path: Path) -> None:
    image = scene()
    grey = image[..., 0]
    got = read_picture(written(tmp_path, "grey.png", saved(grey, "PNG"))).image
    assert np.array_equal(got, np.dstack([grey] * 3))
    alpha = np.dstack([image, np.full(grey.shape, 255, np.uint8)])
    data = cv2.imencode(".png", alpha)[1].tobytes()
    assert np.array_equal(read_picture(written(tmp_path, "alpha.png", data)).image, image)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_exif_turns_as_pillow_does(tmp_path: Path, kind: str, orientation: int) -> None:
    data = with_orientation(scene(), kind, orientation)
    expected = np.asarray(ImageOps.exif_transpose(Image.open(io.BytesIO(data))))[..., ::-1]
    picture = read_picture(written(tmp_path, f"a{KINDS[kind]}", data))
    assert picture.orientation == orientation_of(data) == orientation
    assert picture.image.shape == expected.shape
    assert np.abs(picture.image.astype(int) - expected).mean() < 2.0  # two decoders of JPEG


def test_an_orientation_that_is_none_is_upright() -> None:
    for data in (saved(scene(), "JPEG"), saved(scene(), "BMP"), b"", with_orientation(scene(), "JPEG", 77)):
        assert orientation_of(data) == 1


def test_harmed_headers_raise_nothing() -> None:
    rng = np.random.default_rng(5)
    for kind in KINDS:
        whole = with_orientation(scene(), kind, 6) if kind != "BMP" else saved(scene(), kind)
        for _ in range(300):
            data = bytearray(whole[: rng.integers(1, len(whole))])
            for at in rng.integers(0, min(len(data), 200), 3):
                data[at] = rng.integers(0, 256)
            assert 1 <= orientation_of(bytes(data)) <= 8
            assert "\n" not in fault_of(bytes(data))
