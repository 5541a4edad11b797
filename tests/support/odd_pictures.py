"""Pictures as they should not be, by name: files that Pillow, which comes with matplotlib, or NumPy makes."""

import io
import struct
import zlib
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

KINDS = {"JPEG": ".jpg", "PNG": ".png", "BMP": ".bmp", "TIFF": ".tif"}


def scene(width: int = 64, height: int = 48) -> NDArray[np.uint8]:
    """BGR (height, width, 3) with enough in it to fill a file, and no symmetry."""
    coarse = np.random.default_rng(3).integers(20, 235, (6, 8, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8)


def saved(image: NDArray[Any], kind: str, **options: Any) -> bytes:
    """BGR or grey levels as Pillow writes them."""
    return _file(Image.fromarray(image[..., ::-1] if image.ndim == 3 else image), kind, **options)


def with_orientation(image: NDArray[Any], kind: str, orientation: int) -> bytes:
    """An upright image's pixels under an EXIF orientation, which turns them when they are shown."""
    if kind == "TIFF":
        return saved(image, kind, tiffinfo={274: orientation})
    exif = Image.Exif()
    exif[274] = orientation
    return saved(image, kind, exif=exif)


def huge_png() -> bytes:
    """3 MB that say 32,000 x 32,000 pixels."""
    header = struct.pack(">IIBBBBB", 32_000, 32_000, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(bytes(3_000_000), 0)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def _file(picture: Image.Image, kind: str, **options: Any) -> bytes:
    file = io.BytesIO()
    picture.save(file, kind, **options)
    return file.getvalue()


def _in_cmyk(kind: str) -> bytes:
    return _file(Image.fromarray(scene()).convert("CMYK"), kind)


def _two(kind: str) -> bytes:
    first, second = Image.fromarray(scene()), Image.fromarray(scene()[::-1].copy())
    return _file(first, kind, save_all=True, append_images=[second])


def _encoded(suffix: str, image: NDArray[Any]) -> bytes:
    return bytes(cv2.imencode(suffix, image)[1])


def _cut(kind: str) -> bytes:
    whole = saved(scene(640, 480), kind)
    return whole[: len(whole) * 6 // 10]


REFUSED: dict[str, tuple[str, Callable[[], bytes], str]] = {
    "cmyk jpeg": (".jpg", lambda: _in_cmyk("JPEG"), "CMYK"),
    "cmyk tiff": (".tif", lambda: _in_cmyk("TIFF"), "CMYK"),
    "animated png": (".png", lambda: _two("PNG"), "holds 2 pictures"),
    "stack tiff": (".tif", lambda: _two("TIFF"), "holds several pictures"),
    "raw": (".dng", lambda: saved(scene(), "TIFF", tiffinfo={254: 1}), "begins with a small copy"),
    "gif": (".gif", lambda: _two("GIF"), "no PNG, JPEG, BMP or TIFF"),
    "webp": (".webp", lambda: saved(scene(), "WEBP"), "no PNG, JPEG, BMP or TIFF"),
    "cut jpeg": (".jpg", lambda: _cut("JPEG"), "cut short"),
    "cut png": (".png", lambda: _cut("PNG"), "cut short"),
    "cut bmp": (".bmp", lambda: _cut("BMP"), "cut short"),
    "cut tiff": (".tif", lambda: _cut("TIFF"), "cut short"),
    "12 of 16 bits": (
        ".png",
        lambda: _encoded(".png", scene().astype(np.uint16) * 16),
        "uses the lower ones alone",
    ),
    "floats": (
        ".tif",
        lambda: _encoded(".tif", scene().astype(np.float32) / 255.0),
        "cannot be decoded",
    ),
    "empty": (".png", lambda: b"", "is empty"),
    "text": (".jpg", lambda: b"no image", "no PNG, JPEG, BMP or TIFF"),
    "huge": (".png", huge_png, "is 32000 x 32000 pixels, more than"),
}
