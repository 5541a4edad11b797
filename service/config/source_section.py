"""The config's [camera.source]: where frames come from, read for the whole service by `camera_section`."""

from typing import Annotated, Literal

import msgspec

from service.common.redact import redacted
from service.config.section import ConfigError, Section

Side = Annotated[int, msgspec.Meta(ge=16, le=16384)]
Argument = Annotated[str, msgspec.Meta(max_length=4096)]
_RAW = ("bgr", "nv12", "i420")


class SourceConfig(Section, frozen=True):
    kind: Literal["none", "v4l2", "rtsp", "video", "folder", "command"] = "none"
    path: str = ""  # device, URL, file or folder
    fps: Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)] = 5.0  # a folder's rate, the most taken from others
    latency_ms: Annotated[float, msgspec.Meta(ge=0.0, le=60_000.0)] = (
        0.0  # from the middle of the exposure to the frame's arrival, or to the time that a command writes of it
    )
    # kind = "command": a program and its arguments, which writes frames to its standard output
    command: Annotated[tuple[Argument, ...], msgspec.Meta(max_length=256)] = ()
    format: Literal["y4m", "mjpeg", "bgr", "nv12", "i420"] = "y4m"
    width: Side | None = None  # of bgr, nv12, i420, which do not say it; left out: camera.width, camera.height
    height: Side | None = None
    times: Literal["arrival", "monotonic", "boottime", "unix", "relative"] = "arrival"  # else of lines on descriptor 3
    decode_width: Annotated[int, msgspec.Meta(ge=0, le=16384)] = (
        1920  # mjpeg is decoded at a half, quarter or eighth that has so many columns; 0: always in full
    )

    @property
    def is_live(self) -> bool:
        """Whether it is a camera, whose frames come when they are taken."""
        return self.kind in ("v4l2", "rtsp", "command")

    @property
    def name(self) -> str:
        """What it is called in a line, without its secrets."""
        return self.command[0] if self.command else redacted(self.path)

    def check(self, camera_width: int, camera_height: int) -> None:
        """Raise ConfigError where its keys contradict each other, or raw frames do not fit the camera's size."""
        if self.kind == "command":
            self._check_command(camera_width, camera_height)
            return
        default = SourceConfig()
        for key in ("command", "format", "width", "height", "times", "decode_width"):
            if getattr(self, key) != getattr(default, key):
                raise ConfigError(f"camera.source.{key} is given: it is for kind = 'command', and not '{self.kind}'")
        if self.kind != "none" and not self.path:
            raise ConfigError(f"camera.source.path is empty: kind = '{self.kind}' needs one")

    def _check_command(self, camera_width: int, camera_height: int) -> None:
        if not self.command or not self.command[0]:
            raise ConfigError(
                "camera.source.command names no program: it must be a list, the program and each of its arguments"
            )
        if self.path:
            raise ConfigError(f"camera.source.path is {redacted(self.path)!r}: kind = 'command' takes command alone")
        if (self.width is None) != (self.height is None):
            raise ConfigError("camera.source.width, height: give both, or none for camera.width, camera.height")
        if self.format not in _RAW:
            if self.width is not None:
                raise ConfigError(f"camera.source.width is {self.width}: format = '{self.format}' says its own size")
            return
        width, height = self.width or camera_width, self.height or camera_height
        size = f"camera.source.width, height are {width} x {height}"
        if camera_width % width or camera_height % height or camera_width * height != camera_height * width:
            raise ConfigError(
                f"{size}: they must be camera.width, camera.height, {camera_width} x {camera_height}, or a whole "
                "fraction of them"
            )
        if self.format != "bgr" and (width % 2 or height % 2):
            raise ConfigError(f"{size}: format = '{self.format}' needs even numbers")
