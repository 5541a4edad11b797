"""Frames of files: the images of a folder, a film; `open_source` makes them."""

from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from distloc.geometry.camera import Camera
from service.camera.source import Clock, Closing, SourceError
from service.common.files import IMAGE_SUFFIXES, MOST_PIXELS, FileRefusedError, Picture, TooLargeError, read_picture
from service.common.messages import Frame

_MAX_FILES = 1_000_000
_SLACK_S = 1e-6


class FolderSource(Closing):
    """The images of a folder by name, stamped `fps` a second from the clock's time at the first read."""

    def __init__(self, folder: Path, fps: float, clock: Clock, camera: Camera | None = None) -> None:
        super().__init__(camera)
        if not folder.is_dir():
            raise SourceError(f"camera.source.path is {folder}: no such folder")
        found = (path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
        self._paths = iter(sorted(islice(found, _MAX_FILES)))
        self._period_ns = round(1e9 / fps)
        self._clock = clock
        self._next_ns: int | None = None

    def read(self) -> Frame | None:
        """The next image that can be decoded; the others are counted as bad frames."""
        if self._next_ns is None:
            self._next_ns = self._clock()
        for path in self._paths:
            stamp_ns, self._next_ns = self._next_ns, self._next_ns + self._period_ns
            picture = self._picture(path)
            if picture is not None and self._accepts(picture.image):
                return Frame(stamp_ns, path.name, picture.image, picture.orientation)
        return None

    def close(self) -> None:
        """End the folder."""
        self._paths = iter(())

    def _picture(self, path: Path) -> Picture | None:
        """None where it cannot be used; one that is larger than the camera's is not decoded."""
        camera = self._camera
        try:
            return read_picture(path, most_pixels=camera.width * camera.height if camera else MOST_PIXELS)
        except TooLargeError as error:
            if camera is None:
                self._refuse(str(error))
            else:
                is_first, self._is_first = self._is_first, False
                self._refuse_size(camera, error.size_px, is_first)
        except FileRefusedError as error:
            self._refuse(str(error))
        return None


class VideoSource(Closing):
    """A video file's frames, at most `fps` a second, stamped by the film's own time from the clock's at the first."""

    def __init__(self, path: Path, fps: float, clock: Clock, camera: Camera | None = None) -> None:
        super().__init__(camera)
        if not path.is_file():
            raise SourceError(f"camera.source.path is {path}: no such file")
        self._capture = cv2.VideoCapture(str(path))
        if not self._capture.isOpened():
            raise SourceError(f"camera.source.path is {path}: not a video that OpenCV can read")
        film_fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        self._usual_s = 1.0 / (film_fps if np.isfinite(film_fps) and 0.1 < film_fps < 1000.0 else fps)
        self._period_s = 1.0 / fps
        self._clock = clock
        self._start_ns: int | None = None
        self._number = 0
        self._first_s = self._time_s = 0.0
        self._next_s = 0.0

    def read(self) -> Frame | None:
        """The next frame that is due."""
        if self._start_ns is None:
            self._start_ns = self._clock()
        while self._capture.grab():
            number, time_s = self._number, self._grabbed_s()
            self._number += 1
            if time_s < self._next_s - _SLACK_S:
                continue
            self._next_s = max(self._next_s + self._period_s, time_s - self._period_s)  # no burst after a gap
            ok, image = self._capture.retrieve()
            if not ok:
                self._refuse("the film's frame cannot be decoded")
            elif self._accepts(image):
                return Frame(self._start_ns + round(time_s * 1e9), f"{number:06d}", np.asarray(image, dtype=np.uint8))
        return None

    def close(self) -> None:
        """Release the file."""
        self._capture.release()

    def _grabbed_s(self) -> float:
        """The time of the frame that was grabbed, in the film; one that does not rise goes on at the usual rate."""
        time_s = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3
        if self._number == 0:
            self._first_s = time_s if np.isfinite(time_s) else 0.0
            return 0.0
        time_s -= self._first_s
        is_later = np.isfinite(time_s) and time_s > self._time_s
        self._time_s = time_s if is_later else self._time_s + self._usual_s
        return self._time_s
