"""`study alerts`: watch each sequence with a segmenter at all thresholds at once, then write the curve."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec

from distloc.geometry.camera import Camera
from distloc.study.alerts.names import FrameName
from distloc.study.alerts.watch import SequenceWatch, Watched
from distloc.types import MaskArray, RejectReason
from service.commands.progress import count_progress
from service.commands.study.alerts.sequences import camera_sequences, labelled_frames
from service.commands.study.alerts.table import write_alerts
from service.commands.study.files import load_plots, prepared
from service.commands.study.images import ImageFolderError, LabelledImage, image_folders, tell_strays
from service.commands.study.segmentation.run import segmenter_config
from service.common.messages import Frame
from service.config.sections import ConfigError, SegmenterConfig
from service.segmenters.classical import is_flooded
from service.segmenters.segment import Segmenter, make_segmenter

THRESHOLDS = (0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99)


def run_alerts(
    paths: Sequence[Path],
    segmenter: str,
    thresholds: Sequence[float],
    out: Path,
    say: Callable[[str], None],
    config: Path | None = None,
) -> None:
    """alerts.json, .csv (a line a sequence and threshold), .txt (the table) and .png in `out`.

    Raises ImageFolderError for folders without a sequence, ConfigError for a segmenter that cannot be had.
    """
    settings = segmenter_config(segmenter, None, config)
    load_plots()
    folders = image_folders(paths)
    sequences = camera_sequences(folders, say)
    prepared(out)
    tell_strays(folders, say)
    watched: dict[str, dict[float | None, Watched]] = {}
    done, name, own = 0, segmenter, None
    with count_progress("alerts", sum(len(one.frames) for one in sequences)) as on_done:
        for sequence in sequences:
            watching = _Watching(settings, thresholds)
            for labelled, frame, has_truth in labelled_frames(sequence, say):
                watching.frame(labelled, frame, has_truth, say)
                done += 1
                on_done(done)
            watched[sequence.name] = {at: one.watched() for at, one in watching.watches.items()}
            name, own = watching.name or name, watching.own or own
    if not any(watched.values()):
        raise ImageFolderError(f"{sequences[0].name}: none of the frames can be read")
    write_alerts(out, watched, name, own, say)


def checked_thresholds(text: str) -> tuple[float, ...]:
    """Numbers with commas between them; ConfigError for what is none from 0 to 1."""
    try:
        found = tuple(sorted({float(part) for part in text.split(",")})) if text else THRESHOLDS
    except ValueError:
        found = ()
    if not found or not all(0.0 < one < 1.0 for one in found):
        raise ConfigError(f"--thresholds is {text!r}: it must be numbers above 0 and below 1, as 0.5,0.9")
    return found


class _Watching:
    """One sequence by one segmenter at all thresholds at once."""

    def __init__(self, settings: SegmenterConfig, thresholds: Sequence[float]) -> None:
        self.name = ""
        self.own: float | None = None
        self.watches: dict[float | None, SequenceWatch] = {}
        self._settings, self._thresholds = settings, thresholds
        self._camera: Camera | None = None
        self._segmenter: Segmenter | None = None

    def frame(self, labelled: LabelledImage, named: FrameName, has_truth: bool, say: Callable[[str], None]) -> None:
        """The next one; of another size than the first it is told and left out."""
        height, width = labelled.image.shape[:2]
        camera = self._camera or self._begin(width, height)
        if (camera.width, camera.height) != (width, height):
            say(f"{labelled.path}: is {width} x {height}, the sequence {camera.width} x {camera.height}; left out")
            return
        for threshold, mask in self._masks(Frame(named.unix_s * 10**9, labelled.path.name, labelled.image)):
            self.watches[threshold].frame(named.since_ignition_s, mask, labelled.truth, has_truth)

    def _begin(self, width: int, height: int) -> Camera:
        from service.segmenters.onnx import OnnxSegmenter

        self._camera = camera = Camera(width, height, width, width, (width - 1) / 2.0, (height - 1) / 2.0)
        settings, thresholds = self._settings, list(self._thresholds)
        segmenter = make_segmenter(settings, camera)
        if isinstance(segmenter, OnnxSegmenter):
            self.own = segmenter.threshold
            thresholds = sorted({*thresholds, self.own})
            # boxes below the threshold are left out before they are drawn
            segmenter = make_segmenter(msgspec.structs.replace(settings, threshold=thresholds[0]), camera)
        self._segmenter, self.name = segmenter, segmenter.name
        self.watches = {at: SequenceWatch(camera) for at in (thresholds if self.own is not None else [None])}
        return camera

    def _masks(self, frame: Frame) -> Iterator[tuple[float | None, MaskArray | RejectReason]]:
        from service.segmenters.model_session import ModelError
        from service.segmenters.onnx import OnnxSegmenter

        if not isinstance(self._segmenter, OnnxSegmenter):
            assert self._segmenter is not None
            yield None, self._segmenter.segment(frame, None)
            return
        assert frame.image is not None
        try:
            probability = self._segmenter.probability(frame.image)
        except ModelError:
            yield from ((at, RejectReason.SEGMENTATION_FAILED) for at in self.watches)
            return
        change = self._segmenter.change(frame, None)
        for at in self.watches:
            mask = self._segmenter.mask(probability, at or 0.0, change)
            is_failed = is_flooded(mask, self._settings.flood_share)
            yield at, RejectReason.SEGMENTATION_FLOODED if is_failed else mask
