"""The config's landmarks: what stands at a known place, and the picture by which it is found in the frames."""

import contextlib
from pathlib import Path
from typing import Annotated

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from service.common.files import FileRefusedError, read_picture
from service.config.section import ConfigError, Section

MOST_LANDMARKS = 16
LEAST_SIDE_PX = 9  # smaller ones look like anything
_LEAST_CONTRAST = 3.0  # grey levels, one standard deviation
_HEIGHT_SHARE = 1.5  # a height is read off a map less well than a place


class LandmarkConfig(Section, frozen=True):
    """A mast, a chimney, a peak: the place of the template's middle, the height above mean sea level."""

    name: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
    lat: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
    lon: Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
    alt_m: Annotated[float, msgspec.Meta(ge=-1000.0, le=10_000.0)]
    template: str  # an image file, cut from a frame of full size; relative to the config file
    sigma_m: Annotated[float, msgspec.Meta(ge=0.01, le=100.0)] = 2.0  # of the place; half as much again in height

    @property
    def sigma_enu_m(self) -> tuple[float, float, float]:
        """One standard deviation east, north and up."""
        return self.sigma_m, self.sigma_m, _HEIGHT_SHARE * self.sigma_m


def beside(landmarks: tuple[LandmarkConfig, ...], folder: Path) -> tuple[LandmarkConfig, ...]:
    """The same with the templates' paths as seen from here, for a config file that lies in a folder.

    A recorded flight has them in `landmarks/`, by the landmarks' names.
    """
    return tuple(msgspec.structs.replace(one, template=str(_beside(one, folder))) for one in landmarks)


def _beside(landmark: LandmarkConfig, folder: Path) -> Path:
    given, recorded = folder / landmark.template, folder / "landmarks" / f"{landmark.name}.png"
    with contextlib.suppress(OSError):  # a name that no file may have
        return recorded if not given.exists() and recorded.exists() else given
    return given


def template_bytes(landmarks: tuple[LandmarkConfig, ...]) -> dict[str, bytes]:
    """The templates' files by the landmarks' names, to be recorded; one that is gone by now is left out."""
    found = {}
    for one in landmarks:
        with contextlib.suppress(OSError):
            found[one.name] = Path(one.template).read_bytes()
    return found


def check_landmarks(landmarks: tuple[LandmarkConfig, ...], width: int, height: int) -> None:
    """Raise ConfigError for two of one name, or a template that is none for frames of this size."""
    names: set[str] = set()
    for number, one in enumerate(landmarks):
        if one.name in names:
            raise ConfigError(f"landmarks[{number}].name is '{one.name}': another one has it, each needs its own")
        names.add(one.name)
        read_template(number, one, width, height)


def read_template(number: int, landmark: LandmarkConfig, width: int, height: int) -> NDArray[np.uint8]:
    """The template's grey levels (h, w); ConfigError for what is no picture, or can't be found in frames of a size."""
    key = f"landmarks[{number}].template is '{landmark.template}'"
    try:
        picture = read_picture(Path(landmark.template), most_pixels=width * height, how=cv2.IMREAD_GRAYSCALE)
    except FileRefusedError as error:
        raise ConfigError(f"{key}: {error}; it must be a picture that is cut from a frame") from error
    check_template(key, picture.image, width, height)
    return picture.image


def check_template(what: str, image: NDArray[np.uint8], width: int, height: int) -> None:
    """Raise ConfigError for grey levels (h, w) that can't be found in frames of a size; it begins with `what` it is."""
    rows, columns = image.shape
    if rows > height // 2 or columns > width // 2:
        raise ConfigError(
            f"{what}, {columns} x {rows} pixels: at most half of the frame's {width} x {height}: cut it closer"
        )
    if min(rows, columns) < LEAST_SIDE_PX:
        raise ConfigError(
            f"{what}, {columns} x {rows} pixels: at least {LEAST_SIDE_PX} x {LEAST_SIDE_PX}: cut it wider"
        )
    if float(image.std()) < _LEAST_CONTRAST:
        raise ConfigError(f"{what}: it is all of one grey: cut it where the landmark stands out")
