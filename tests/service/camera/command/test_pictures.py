"""Raw frames and JPEGs are decoded as they were made, JPEGs smaller where that is enough."""

import cv2
import numpy as np
import pytest

from service.camera.command.pictures import Jpeg, Layout, PictureError, Planes
from tests.support.odd_pictures import REFUSED

WIDTH, HEIGHT = 128, 64


def smooth() -> np.ndarray:
    """Colours that change slowly, so that chroma at half the size loses nothing."""
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.dstack([40 + u, 220 - u, 60 + v]).astype(np.uint8)


def i420() -> np.ndarray:
    return np.asarray(cv2.cvtColor(smooth(), cv2.COLOR_BGR2YUV_I420)).reshape(-1)


def nv12() -> np.ndarray:
    data, pixels = i420(), WIDTH * HEIGHT
    chroma = np.stack([data[pixels : pixels * 5 // 4], data[pixels * 5 // 4 :]], axis=1)
    return np.concatenate([data[:pixels], chroma.reshape(-1)])


@pytest.mark.parametrize("layout", Layout)
def test_raw_frames(layout: Layout) -> None:
    data = {Layout.BGR: smooth().reshape(-1), Layout.NV12: nv12(), Layout.I420: i420()}[layout]
    assert data.size == layout.bytes_of((WIDTH, HEIGHT))
    image = Planes(data, (WIDTH, HEIGHT), layout).decoded(0)
    assert image.shape == (HEIGHT, WIDTH, 3) and image.dtype == np.uint8
    assert np.abs(image.astype(int) - smooth()).max() <= (0 if layout is Layout.BGR else 4)


@pytest.mark.parametrize(
    ("least", "width"), [(0, 128), (128, 128), (65, 128), (64, 64), (33, 64), (32, 32), (16, 16), (1, 16)]
)
def test_a_jpeg_is_decoded_as_small_as_is_enough(least: int, width: int) -> None:
    one = Jpeg(cv2.imencode(".jpg", smooth(), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes())
    image = one.decoded(least)
    assert one.size_px == (WIDTH, HEIGHT) and image.shape == (width // 2, width, 3)
    small = cv2.resize(smooth(), (width, width // 2), interpolation=cv2.INTER_AREA)
    assert np.abs(image.astype(int) - small).mean() < 3.0


def test_a_size_that_would_not_be_whole_stays() -> None:
    one = Jpeg(cv2.imencode(".jpg", smooth()[:50, :100])[1].tobytes())
    assert one.decoded(20).shape == (25, 50, 3)  # 12.5 rows at a quarter


@pytest.mark.parametrize("name", [name for name, (suffix, _, _) in REFUSED.items() if suffix in (".jpg", ".jpeg")])
def test_odd_jpegs_are_refused(name: str) -> None:
    with pytest.raises(PictureError, match="a JPEG"):
        Jpeg(REFUSED[name][1]()).decoded(0)
