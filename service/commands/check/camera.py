"""The doctor's look through the camera: frames come, at what rate, fresh, not frozen, sharp and rightly exposed."""

import threading
import time
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from service.camera.sources import SourceError, open_source
from service.commands.check.finding import Finding, fail, ok, warn
from service.config.sections import CameraConfig

_ENOUGH_FRAMES = 30  # a file's come as fast as they are read
_STALE_S = 3.0  # as the service's health has it
_JOIN_S = 2.0
_WIDTH_PX = 640
# Variance of the Laplacian at 640 pixels of width: 16 to 38 for our renderer's smooth landscape, 1 to 3 for the same
# behind a blur of 2 pixels; 980 for a photograph, 3 behind a blur of 4 pixels.
_SHARP = 8.0
_DARK, _BRIGHT = 12.0, 243.0  # mean of an 8-bit picture
_LEAST_SHARE = 0.7  # of the rate asked for


@dataclass(slots=True)
class _Seen:
    """What the reading thread saw; the arrays of a frame are not kept."""

    count: int = 0
    repeats: int = 0
    size: tuple[int, int] = (0, 0)
    sharpness: list[float] = field(default_factory=list)
    means: list[float] = field(default_factory=list)
    first_s: float = 0.0
    last_s: float = 0.0
    error: str = ""
    last_small: NDArray[np.uint8] | None = None


def check_camera(config: CameraConfig, listen_s: float) -> list[Finding]:
    """What can be said within `listen_s`; blocks."""
    if config.source.kind == "none":
        return [warn("camera", "camera.source.kind is 'none': the service will see nothing", "name a camera")]
    seen, ended = _Seen(), threading.Event()
    reader = threading.Thread(target=_read, args=(config, seen, ended), name="camera", daemon=True)
    start_s = time.monotonic()
    reader.start()
    reader.join(listen_s)
    ended.set()
    is_over = not reader.is_alive()
    now_s = time.monotonic()
    reader.join(_JOIN_S)  # a camera that hangs holds its thread up: it is left behind
    if seen.error:
        return [fail("camera", seen.error, "correct camera.source or the size, plug the camera in, check its group")]
    if not seen.count:
        said = f"{config.source.name} gives no frame in {now_s - start_s:.0f} s"
        mend = "check the cable, the address, and that no other program holds it"
        if config.source.kind == "command":
            mend = "run the command by hand, with | wc -c behind it: it must write frames to its standard output"
        return [fail("camera", said, mend)]
    return _judged(config, seen, is_over, now_s)


def _read(config: CameraConfig, seen: _Seen, ended: threading.Event) -> None:
    is_live = config.source.is_live
    try:
        with open_source(config.source, config.camera(), time.monotonic_ns) as source:
            while not ended.is_set() and (is_live or seen.count < _ENOUGH_FRAMES):
                frame = source.read()
                if frame is None:
                    return
                if frame.image is not None:
                    _look(seen, frame.image)
    except SourceError as error:
        seen.error = str(error)


def _look(seen: _Seen, image: NDArray[np.uint8]) -> None:
    height, width = image.shape[:2]
    small_height = max(1, round(height * _WIDTH_PX / width))
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    small = np.asarray(cv2.resize(grey, (_WIDTH_PX, small_height), interpolation=cv2.INTER_AREA), np.uint8)
    seen.repeats += seen.last_small is not None and bool(np.array_equal(seen.last_small, small))
    seen.last_small, seen.size = small, (width, height)
    if len(seen.sharpness) < 10 * _ENOUGH_FRAMES:
        seen.sharpness.append(float(cv2.Laplacian(small, cv2.CV_32F).var()))
        seen.means.append(float(small.mean()))
    seen.last_s = time.monotonic()
    seen.first_s = seen.first_s or seen.last_s
    seen.count += 1


def _judged(config: CameraConfig, seen: _Seen, is_over: bool, now_s: float) -> list[Finding]:
    sharpness, mean = float(np.median(seen.sharpness)), float(np.median(seen.means))
    said = f"{seen.count} frames of {seen.size[0]} x {seen.size[1]}"
    is_live = config.source.is_live
    findings = []
    if is_live and (is_over or now_s - seen.last_s > _STALE_S):
        findings.append(fail("camera", f"{said}, the last {now_s - seen.last_s:.1f} s old", "check cable and power"))
    elif is_live and seen.count > 1:
        hz = (seen.count - 1) / (seen.last_s - seen.first_s)
        said += f", {hz:.1f} a second"
        if hz < _LEAST_SHARE * config.source.fps:
            mend = f"lower camera.source.fps from {config.source.fps:g}, or the camera's resolution or exposure"
            findings.append(warn("camera", f"only {hz:.1f} frames a second", mend))
    if seen.count > 2 and seen.repeats == seen.count - 1:
        findings.append(fail("camera", f"{said}: all the same picture", "start the camera again: it is frozen"))
    if not _DARK < mean < _BRIGHT:
        state = "dark" if mean <= _DARK else "overexposed"
        findings.append(warn("camera", f"{state}: mean level {mean:.0f} of 255", "take the cap off, set the exposure"))
    elif sharpness < _SHARP:
        mend = "focus and clean the lens, or point it at the horizon"
        findings.append(
            warn("camera", f"blurred, or no detail in view: sharpness {sharpness:.0f} of {_SHARP:.0f}", mend)
        )
    if any(finding.level == "fail" for finding in findings):
        return findings
    return [ok("camera", f"{said}, sharpness {sharpness:.0f}"), *findings]
