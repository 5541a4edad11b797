"""The config's [camera]: intrinsics, mount and source, read for the whole service by `sections`."""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_euler
from distloc.types import FloatArray
from service.config.section import ConfigError, Degrees, Section
from service.config.source_section import SourceConfig

Lever = Annotated[float, msgspec.Meta(ge=-100.0, le=100.0)]


class MountConfig(Section, frozen=True):
    yaw_deg: Degrees = 0.0
    pitch_deg: Degrees = 0.0
    roll_deg: Degrees = 0.0
    forward_m: Lever = 0.0  # lever arm of the camera in the body's axes
    right_m: Lever = 0.0
    down_m: Lever = 0.0
    sigma_deg: Annotated[float, msgspec.Meta(gt=0.0, le=180.0)] | None = (
        None  # one standard deviation of each angle, as a calibration says it; left out: 1 where they were set by hand
    )
    gimbal: bool = False  # the angles are then relative to the gimbal that the autopilot reports
    gimbal_device: Annotated[int, msgspec.Meta(ge=0, le=255)] = 0  # 1-6, or its component's id; 0: the only one heard

    @property
    def R_body_from_mount(self) -> FloatArray:
        """(3, 3)."""
        return matrix_from_euler(*np.radians([self.yaw_deg, self.pitch_deg, self.roll_deg]))

    @property
    def lever_arm_body_m(self) -> FloatArray:
        """(3,) forward, right, down."""
        return np.array([self.forward_m, self.right_m, self.down_m])


_WIDTH, _HEIGHT, _INTRINSICS = 1920, 1080, (1200.0, 1200.0, 960.0, 540.0)  # where nothing at all is given
_LEAST_VIEW_DEG, _MOST_VIEW_DEG = 0.5, 170.0  # of a lens without a fisheye's bend
_MOST_ASPECT = 2.5  # of a pixel, an anamorphic lens' included


class CameraConfig(Section, frozen=True):
    width: Annotated[int, msgspec.Meta(ge=16, le=16384)] = _WIDTH
    height: Annotated[int, msgspec.Meta(ge=16, le=16384)] = _HEIGHT
    hfov_deg: Annotated[float, msgspec.Meta(ge=_LEAST_VIEW_DEG, le=_MOST_VIEW_DEG)] | None = None  # without fx to cy
    fx: Annotated[float, msgspec.Meta(gt=0.0, le=1e7)] | None = None  # all four of a calibration at that size, or none
    fy: Annotated[float, msgspec.Meta(gt=0.0, le=1e7)] | None = None
    cx: float | None = None
    cy: float | None = None
    distortion: tuple[float, ...] = ()
    model: Literal["brown-conrady", "fisheye"] = "brown-conrady"
    device: Annotated[int, msgspec.Meta(ge=0, le=255)] = 0  # 1-6, or its component's id; 0: all that tell their zoom
    zoom_level: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 0.0  # per cent, at which it was calibrated
    mount: MountConfig = MountConfig()
    source: SourceConfig = SourceConfig()

    def camera(self) -> Camera:
        """The camera model; ConfigError where the keys do not make one camera."""
        fx, fy, cx, cy = self._intrinsics()
        try:
            camera = Camera(self.width, self.height, fx, fy, cx, cy, self.distortion, self.model)
        except ValueError as error:
            raise ConfigError(f"camera: {error}") from error
        if not (0.0 <= cx <= self.width and 0.0 <= cy <= self.height):
            raise ConfigError(
                f"camera.cx, camera.cy are {cx:g}, {cy:g}: the principal point must lie in the image of "
                f"{self.width} x {self.height}; was it calibrated at another size?"
            )
        if not 1.0 / _MOST_ASPECT <= fx / fy <= _MOST_ASPECT:
            raise ConfigError(f"camera.fx, camera.fy are {fx:g}, {fy:g}: they must be nearly alike, pixels are square")
        view_deg = field_of_view_deg(camera)[0]
        if self.model != "fisheye" and not _LEAST_VIEW_DEG <= view_deg <= _MOST_VIEW_DEG:
            raise ConfigError(
                f"camera.fx is {fx:g}: at a width of {self.width} that is a view of {view_deg:.3g} degrees, "
                f"it must be {_LEAST_VIEW_DEG:g} to {_MOST_VIEW_DEG:g}"
            )
        return camera

    def _intrinsics(self) -> tuple[float, float, float, float]:
        """The four as given, or of `hfov_deg` with square pixels and the principal point in the middle."""
        size = f"{self.width} x {self.height}"
        if self.fx is not None and self.fy is not None and self.cx is not None and self.cy is not None:
            if self.hfov_deg is not None:
                raise ConfigError(f"camera.hfov_deg is {self.hfov_deg:g} beside camera.fx: give one of them")
            return self.fx, self.fy, self.cx, self.cy
        given = [key for key in ("fx", "fy", "cx", "cy") if getattr(self, key) is not None]
        if given:
            lacking = [key for key in ("fx", "fy", "cx", "cy") if key not in given]
            raise ConfigError(
                f"camera has {', '.join(given)} and lacks {', '.join(lacking)}: give all four, of one calibration at "
                f"{size}, or none of them and camera.hfov_deg"
            )
        if self.distortion or self.model == "fisheye":
            raise ConfigError(
                f"camera.distortion, camera.model are {list(self.distortion)}, {self.model!r} without fx, fy, cx, cy: "
                "they come from one calibration, give all of it"
            )
        if self.hfov_deg is not None:
            f = self.width / 2.0 / math.tan(math.radians(self.hfov_deg) / 2.0)
            return f, f, (self.width - 1) / 2.0, (self.height - 1) / 2.0
        if (self.width, self.height) != (_WIDTH, _HEIGHT):
            raise ConfigError(
                f"camera.width, camera.height are {size} without fx, fy, cx, cy: give all four, of a calibration at "
                "that size, or camera.hfov_deg, the lens' horizontal view in degrees"
            )
        return _INTRINSICS


def field_of_view_deg(camera: Camera) -> tuple[float, float]:
    """What the image spans across and down, through its middle; distortion left out."""
    if camera.model == "fisheye":
        return math.degrees(camera.width / camera.fx), math.degrees(camera.height / camera.fy)
    across = (math.atan((camera.cx + 0.5) / camera.fx), math.atan((camera.width - 0.5 - camera.cx) / camera.fx))
    down = (math.atan((camera.cy + 0.5) / camera.fy), math.atan((camera.height - 0.5 - camera.cy) / camera.fy))
    return math.degrees(sum(across)), math.degrees(sum(down))
