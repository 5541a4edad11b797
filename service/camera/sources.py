"""Where frames come from: files, a camera, a network stream, a process; the pipeline reads them."""

from collections import Counter
from functools import partial
from pathlib import Path
from types import TracebackType

from distloc.backports import Self
from distloc.geometry.camera import Camera
from distloc.types import RejectReason
from service.camera.command.source import CommandSource
from service.camera.files import FolderSource, VideoSource
from service.camera.live import CaptureSource, asked_capture
from service.camera.paced import PacedSource
from service.camera.source import Clock, FrameSource, SizeError, SourceError, fits
from service.common.messages import Frame
from service.config.sections import SourceConfig

__all__ = [
    "CaptureSource",
    "CommandSource",
    "FolderSource",
    "FrameSource",
    "NoSource",
    "SizeError",
    "SourceError",
    "VideoSource",
    "fits",
    "open_source",
]


class NoSource:
    """No camera: ends at once."""

    def __init__(self) -> None:
        self.rejected: Counter[RejectReason] = Counter()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def read(self) -> Frame | None:
        """None."""
        return None

    def close(self) -> None:
        """Nothing to close."""


def open_source(
    config: SourceConfig, camera: Camera, clock_ns: Clock, is_awaited: bool = False, is_paced: bool = False
) -> FrameSource:
    """The source that a configuration asks for; SourceError in one line where it is missing.

    With `is_awaited` a camera or stream may be missing at first: it is tried again like one that was lost. With
    `is_paced` a file's frames come at their own time and not as fast as the disk gives them.
    """
    if config.kind == "none":
        return NoSource()
    if config.kind in ("folder", "video"):
        kind = FolderSource if config.kind == "folder" else VideoSource
        source = kind(Path(config.path), config.fps, clock_ns, camera)
        return PacedSource(source, clock_ns) if is_paced else source
    if config.kind == "command":
        return CommandSource(config, camera, clock_ns, is_awaited)
    latency_ns = round(config.latency_ms * 1e6)
    ask = partial(asked_capture, width=camera.width, height=camera.height, fps=config.fps)
    opens = ask if config.kind == "v4l2" else None
    return CaptureSource(config.path, latency_ns, clock_ns, camera, opens, fps=config.fps, is_awaited=is_awaited)
