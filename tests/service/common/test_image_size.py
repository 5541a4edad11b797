"""Sizes from headers, as OpenCV writes them, cut and random."""

import random

import cv2
import numpy as np
import pytest

from service.common.image_size import size_from_header

KINDS = (".png", ".jpg", ".bmp", ".tif")


def encoded(kind: str) -> bytes:
    rng = np.random.default_rng(1)
    return cv2.imencode(kind, rng.integers(0, 255, (37, 53, 3), dtype=np.uint8))[1].tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_the_size_that_is_decoded(kind: str) -> None:
    assert size_from_header(encoded(kind)) == (53, 37)


def test_a_progressive_jpeg_with_comments() -> None:
    image = np.zeros((37, 53, 3), np.uint8)
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    comment = b"\xff\xff\xfe" + (10_000).to_bytes(2, "big") + bytes(9_998)
    assert size_from_header(data[:2] + comment + data[2:]) == (53, 37)


def test_of_two_headers_the_larger_counts() -> None:
    data = encoded(".jpg")
    other = b"\xff\xc0\x00\x0b\x08" + (9).to_bytes(2, "big") + (8000).to_bytes(2, "big") + bytes(4)
    assert size_from_header(data[:2] + other + data[2:]) == (8000, 37)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_cut_or_harmed_raises_nothing(kind: str) -> None:
    rng = random.Random(2)
    whole = encoded(kind)
    for _ in range(500):
        data = bytearray(whole[: rng.randrange(len(whole))])
        for _ in range(rng.randrange(4)):
            if data:
                data[rng.randrange(min(len(data), 64))] = rng.randrange(256)
        size = size_from_header(bytes(data))
        assert size is None or min(size) > 0


def test_other_kinds_have_none() -> None:
    assert size_from_header(b"") is None and size_from_header(b"GIF89a" + bytes(40)) is None
