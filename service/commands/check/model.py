"""`distloc check --model`: what a model takes and gives, how fast it is here, and what it sees in an image."""

import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.sights.detections import detections_from_mask
from distloc.types import Detection, RejectReason
from service.commands.check.finding import Finding, ok, warn
from service.commands.check.segmenter import provider_findings
from service.common.files import FileRefusedError, read_picture, write_whole
from service.common.messages import Frame
from service.common.shown import shown
from service.config.sections import CameraConfig, Config, ConfigError, SegmenterConfig
from service.publish.overlay import encoded_png
from service.segmenters.accelerator.assignment import short
from service.segmenters.exporter_card import KEYS as EXPORTER_KEYS
from service.segmenters.model_card import PREFIX
from service.segmenters.model_session import TENSORRT, ModelError, ModelSession, open_on_cpu
from service.segmenters.onnx import OnnxSegmenter
from service.segmenters.segment import make_accelerator, shipped_model

_RUNS = 20
_NEAR, _MOVED_SHARE = 0.05, 0.001  # what fp16 may cost: of a probability, and of the mask's pixels
_YELLOW = (0, 255, 255)

Say = Callable[[str], None]


def run_check_model(model: Path | None, image_path: Path | None, out: Path, config: Config | None, say: Say) -> bool:
    """Try a model (the config's or the shipped one where None) as the config's [segmenter] would; True if it works."""
    try:
        return _works(_settings(model, config), image_path, out, config, say)
    except (ConfigError, ModelError) as error:
        say(f"fail  {shown(error)}")
        return False


def _works(settings: SegmenterConfig, image_path: Path | None, out: Path, config: Config | None, say: Say) -> bool:
    with closing(make_accelerator(settings, is_told=False)) as accelerator:
        image = _image(image_path, config)
        camera = _camera(image, config)
        session = open_on_cpu(Path(settings.model), settings.providers, settings.sha256)
        _say_ports(session, settings, say)
        segmenter = OnnxSegmenter(session, camera, settings, accelerator)
        accelerator.start()
        segmenter.settle(image)
        for finding in provider_findings(accelerator.state):
            say(str(finding))
        say(f"ok    provider: {segmenter.provider}, asked for {', '.join(settings.providers)}")
        _say_times(segmenter, image, say)
        if accelerator.state.state == "used":
            say(str(accuracy(segmenter, image, settings.fp16)))
        return image_path is None or _look(segmenter, image, camera, out, say)


def _settings(model: Path | None, config: Config | None) -> SegmenterConfig:
    settings = config.segmenter if config else SegmenterConfig()
    path = model or (Path(settings.model) if settings.model else shipped_model())
    sha256 = "" if model else settings.sha256  # the config's is of the config's model
    return msgspec.structs.replace(settings, kind="onnx", model=str(path), sha256=sha256)


def _image(path: Path | None, config: Config | None) -> NDArray[np.uint8]:
    if path is None:
        camera = config.camera if config else CameraConfig()
        return np.full((camera.height, camera.width, 3), 128, np.uint8)
    try:
        return read_picture(path).image
    except FileRefusedError as error:
        raise ConfigError(f"--image: no image that can be read: {error}") from error


def _camera(image: NDArray[np.uint8], config: Config | None) -> Camera:
    """The config's; without one, any camera with the image's size: only that matters here."""
    if config:
        return config.camera.camera()
    height, width = image.shape[:2]
    return Camera(width, height, width, width, width / 2.0, height / 2.0)


def _say_ports(session: ModelSession, settings: SegmenterConfig, say: Say) -> None:
    for port in session.inputs:
        say(f"ok    input: {shown(port)}")
    for port in session.outputs:
        say(f"ok    output: {shown(port)}")
    stated = [
        shown(f"{key.removeprefix(PREFIX)} = {text}")
        for key, text in session.metadata.items()
        if key.startswith(PREFIX)
    ]
    say(f"ok    metadata: {'; '.join(stated) or 'nothing of ' + PREFIX + 'KEY'}")
    told = [shown(f"{key} = {text:.200}") for key, text in session.metadata.items() if key in EXPORTER_KEYS]
    if told:
        say(f"ok    exporter: {'; '.join(told)}")
    given = msgspec.to_builtins(settings.preprocessing)
    if given:
        say(f"ok    config: {'; '.join(f'{key} = {value}' for key, value in given.items())}")


def _say_times(segmenter: OnnxSegmenter, image: NDArray[np.uint8], say: Say) -> None:
    places = segmenter.placements(image.shape[1], image.shape[0])
    run_ms = _median_ms(lambda: segmenter.run(image, places[0]))
    frame_ms = _median_ms(lambda: segmenter.probability(image))
    size = f"{places[0].across.side} x {places[0].down.side}"
    tiles = f" and {len(places) - 1} tiles" if len(places) > 1 else ""
    say(f"ok    time: {run_ms:.1f} ms a run at {size}, {frame_ms:.1f} ms a frame{tiles} (medians of {_RUNS})")


def accuracy(segmenter: OnnxSegmenter, image: NDArray[np.uint8], is_fp16: bool) -> Finding:
    """What a GPU's arithmetic costs on an image, beside the CPU's, which has 32 bits."""
    own, other = segmenter.own_probability(image), segmenter.probability(image)
    off = np.abs(own - other)
    moved = int(((own > segmenter.threshold) != (other > segmenter.threshold)).sum())
    bits = "16 bits" if is_fp16 and segmenter.provider == TENSORRT else "32 bits"
    said = (
        f"{short(segmenter.provider)} with {bits} is {off.max():.4f} off the CPU's probabilities at the most, "
        f"{np.sqrt(np.mean(off**2)):.4f} rms; {moved} of {own.size} pixels of the mask change sides"
    )
    if off.max() <= _NEAR and moved <= _MOVED_SHARE * own.size:
        return ok("accuracy", said)
    return warn("accuracy", said, "leave segmenter.fp16 out" if is_fp16 else "take the CPU's provider alone")


def _median_ms(run: Callable[[], object]) -> float:
    run()
    times_ms = []
    for _ in range(_RUNS):
        start_s = time.perf_counter()
        run()
        times_ms.append((time.perf_counter() - start_s) * 1e3)
    return float(np.median(times_ms))


def _look(segmenter: OnnxSegmenter, image: NDArray[np.uint8], camera: Camera, out: Path, say: Say) -> bool:
    mask = segmenter.segment(Frame(0, "image", image), None)
    if isinstance(mask, RejectReason):
        say(f"fail  image: {mask}")
        return False
    found = detections_from_mask(mask, camera)
    probability = segmenter.probability(image)
    scores = [_score(probability, one, camera) for one in found]
    say(f"ok    image: {len(found)} segment{'s' * (len(found) != 1)} above {segmenter.threshold:g}")
    for one, score in zip(found, scores, strict=True):
        share = one.area_px / (camera.width * camera.height)
        centre = f"({one.centre_px[0]:.0f}, {one.centre_px[1]:.0f})"
        size = f"{one.width_px:.0f} x {one.height_px:.0f} px"
        say(f"ok    segment: centre {centre}, {size}, {share:.2%} of the frame, score {score:.2f}")
    try:
        write_whole(out, encoded_png(_drawn(image, mask, found, scores, camera)))
    except OSError as error:
        say(f"fail  overlay: {out} cannot be written: {error.strerror}")
        return False
    say(f"ok    overlay: {out}")
    return True


def _score(probability: NDArray[np.float32], one: Detection, camera: Camera) -> float:
    """The highest probability in the segment's bounding box."""
    left, top, right, bottom = _box(one, probability.shape[1] / camera.width)
    return float(probability[top : bottom + 1, left : right + 1].max())


def _box(one: Detection, factor: float) -> tuple[int, int, int, int]:
    """Left, top, right, bottom in pixels of an image `factor` times as wide as the camera's."""
    u, v = one.centre_px
    corners = (u - one.width_px / 2, v - one.height_px / 2, u + one.width_px / 2, v + one.height_px / 2)
    left, top, right, bottom = (max(0, round(float(value) * factor)) for value in corners)
    return left, top, right, bottom


def _drawn(
    image: NDArray[np.uint8], mask: NDArray[np.uint8], found: list[Detection], scores: list[float], camera: Camera
) -> NDArray[np.uint8]:
    """A copy of the image with the segments' outlines and scores."""
    picture = image.copy()
    height, width = picture.shape[:2]
    full = cv2.resize(mask, (width, height), interpolation=cv2.INTER_NEAREST)
    contours, _ = cv2.findContours(full, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    cv2.drawContours(picture, contours, -1, _YELLOW, 2, cv2.LINE_AA)
    for one, score in zip(found, scores, strict=True):
        left, top, _, _ = _box(one, width / camera.width)
        at = (left, max(16, top - 6))
        cv2.putText(picture, f"{score:.2f}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.6, _YELLOW, 2, cv2.LINE_AA)
    return picture
