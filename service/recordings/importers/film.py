"""A film's frames with their times and size, by the container's own stamps; the readers of films and logs call it."""

from pathlib import Path

import cv2
import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.flight import Film, ImportedFlight, ImportRefusedError, Lens, Remarks

MOST_FRAMES = 1_000_000  # as many as a recording's table may have
_UNEVEN = 1.5  # a frame that lasts so much longer than the median: the rate varies
_LEAST_RISE_S = 1e-6


def read_film(path: Path) -> ImportedFlight:
    """A film by itself: its frames' times count from its first frame, and are tied to nothing."""
    lens, film, remarks = film_of(path)
    return ImportedFlight(path.name, None, lens=lens, frames=film, frames_tied=False, remarks=remarks)


def film_of(path: Path) -> tuple[Lens, Film, Remarks]:
    """Its size, its frames' times from the first one on, and what there is to say of them.

    Every frame is grabbed once: by frame number and rate the times of a film of variable rate would be wrong. Raises
    ImportRefusedError where OpenCV cannot read it.
    """
    capture = cv2.VideoCapture(str(path))
    try:
        if not capture.isOpened():
            raise ImportRefusedError(f"{path}: is no film that OpenCV can read: MP4 with H.264 is")
        times_s = _times_s(path, capture)
        if not len(times_s):
            raise ImportRefusedError(f"{path}: no frame of it can be decoded: is it cut off?")
        ok, image = capture.read() if capture.set(cv2.CAP_PROP_POS_FRAMES, 0) else (False, None)
        size = (image.shape[1], image.shape[0]) if ok and image is not None else _told_size(capture)
    finally:
        capture.release()
    remarks = Remarks()
    steps_s = np.diff(times_s)
    rate = f", {1.0 / float(np.median(steps_s)):.2f} frames/s" if len(steps_s) else ""
    uneven = " of variable rate" if len(steps_s) and steps_s.max() > _UNEVEN * np.median(steps_s) else ""
    remarks.found.append(f"film{uneven}: {len(times_s)} frames, {size[0]} x {size[1]}, {times_s[-1]:.1f} s{rate}")
    return Lens(*size), Film(path, times_s), remarks


def _times_s(path: Path, capture: cv2.VideoCapture) -> FloatArray:
    told_fps = float(capture.get(cv2.CAP_PROP_FPS))
    usual_s = 1.0 / told_fps if np.isfinite(told_fps) and 0.1 < told_fps < 1000.0 else 1.0 / 30.0
    times_s: list[float] = []
    while capture.grab():
        if len(times_s) == MOST_FRAMES:
            raise ImportRefusedError(f"{path}: more than {MOST_FRAMES} frames: cut it")
        time_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) * 1e-3
        is_later = np.isfinite(time_s) and (not times_s or time_s > times_s[-1] + _LEAST_RISE_S)
        times_s.append(time_s if is_later else times_s[-1] + usual_s if times_s else 0.0)
    return np.array(times_s) - times_s[0] if times_s else np.zeros(0)


def _told_size(capture: cv2.VideoCapture) -> tuple[int, int]:
    return int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
