"""The config's landmarks in flight: found in each frame, and whether they agree with the rest of the scenery.

`scenery` owns one and calls it from the thread that localises.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.geometry.geodesy import LocalFrame
from distloc.scenery.aided import Aided
from distloc.scenery.corners import Corners, KnownCorners
from distloc.scenery.landmark_finder import LandmarkFinder
from distloc.types import BoolArray, CameraPose, FloatArray
from service.config.landmarks import LandmarkConfig, read_template

log = logging.getLogger(__name__)

MISFIT = "landmark_misfit"
_NEVER = 10  # keyframes in which it did not fit, and none in which it did
_NONE = KnownCorners()


class Landmarks(Protocol):
    """What the scenery calls, in its order."""

    def find(
        self, image: NDArray[np.uint8], pose: CameraPose, sigma_rad: float, smoke: NDArray[np.uint8] | None
    ) -> KnownCorners:
        """Those in a frame; `pose` is the best that is known, with one sigma of its attitude."""
        ...

    def outside(self, corners: Corners, smoke: NDArray[np.uint8]) -> Corners:
        """A frame's corners without the landmarks that are in its smoke, found later."""
        ...

    def forget(self) -> None:
        """The next frame has none before it."""
        ...

    def note(self, aided: Aided) -> Mapping[str, str]:
        """The localizer has stepped: what each landmark is good for, by its name."""
        ...


class NoLandmarks:
    """For a config without any."""

    def find(
        self, image: NDArray[np.uint8], pose: CameraPose, sigma_rad: float, smoke: NDArray[np.uint8] | None
    ) -> KnownCorners:
        """None."""
        return _NONE

    def outside(self, corners: Corners, smoke: NDArray[np.uint8]) -> Corners:
        """The same: they have none."""
        return corners

    def forget(self) -> None:
        """Nothing to forget."""

    def note(self, aided: Aided) -> Mapping[str, str]:
        """None."""
        return {}


class WatchedLandmarks:
    """Finds the landmarks once `frame_enu` says where the map's origin is."""

    def __init__(
        self, camera: Camera, landmarks: tuple[LandmarkConfig, ...], frame_enu: Callable[[], LocalFrame | None]
    ) -> None:
        size = (camera.width, camera.height)
        self._finder = LandmarkFinder(camera, [read_template(i, one, *size) for i, one in enumerate(landmarks)])
        self._landmarks, self._frame_enu = landmarks, frame_enu
        self._found = _NONE
        self._told = [False] * len(landmarks)
        self._is_misfit: BoolArray = np.zeros(len(landmarks), dtype=np.bool_)

    def find(
        self, image: NDArray[np.uint8], pose: CameraPose, sigma_rad: float, smoke: NDArray[np.uint8] | None
    ) -> KnownCorners:
        """Those in a frame."""
        frame_enu, found = self._frame_enu(), _NONE
        self._finder.doubt(self._is_misfit)
        if frame_enu is not None:
            places_enu_m: FloatArray = np.stack(
                [frame_enu.enu_from_geodetic(one.lat, one.lon, one.alt_m) for one in self._landmarks]
            )
            found = self._finder.find(image, pose, places_enu_m, sigma_rad, smoke)
        self._found = found  # at once: another thread may be reading
        return found

    def outside(self, corners: Corners, smoke: NDArray[np.uint8]) -> Corners:
        """A frame's corners without the landmarks that are in its smoke."""
        free = self._finder.outside(corners.known, smoke)
        if self._found is corners.known:
            self._found = free
        return corners if free is corners.known else replace(corners, known=free)

    def forget(self) -> None:
        """The next frame has none before it."""
        self._finder.forget()

    def note(self, aided: Aided) -> Mapping[str, str]:
        """`used`, `misfit`: not where the rest of the scenery says, `found`: not counted yet, `unseen`."""
        self._is_misfit = is_misfit = (aided.contradicting > 0) & ~aided.is_trusted  # at once, as above
        states = {}
        for i, one in enumerate(self._landmarks):
            is_found = bool((self._found.names == i).any())
            states[one.name] = (
                "unseen" if not is_found else "used" if aided.is_trusted[i] else "misfit" if is_misfit[i] else "found"
            )
            if not self._told[i] and aided.misfits[i] >= _NEVER and not aided.agreed[i]:
                self._told[i] = True
                log.warning(
                    "landmark '%s' was found in %d steps and never where it should be: are its lat, lon, alt_m (above "
                    "the sea) and template right?",
                    one.name,
                    aided.misfits[i],
                )
        return states
