"""Where a row of a table looks: by angles, through a pixel, or at the foot of a box, with how well that was marked."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from distloc.batch.sighting import direction_from_azimuth, direction_from_pixel
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.types import FloatArray
from service.config.sections import Config, ConfigError
from service.recordings.sightings.boxes import Box, box_of
from service.recordings.sightings.columns import RowError

_ANY_ELEVATION_RAD = math.radians(10.0)  # one standard deviation, where only a bearing is given
_MARKED_PX = 3.0  # of a pixel that somebody or something marked
_SQUARE_PX = 10_000.0  # of a picture whose size nobody told, in which only shares of its width count
_FISHEYE = ("fisheye", "equidistant")
_PINHOLE = ("rectilinear", "pinhole", "perspective")


@dataclass(frozen=True, slots=True)
class Aim:
    """A direction (3,) in the camera's east, north and up, and one standard deviation across and upright.

    `is_box`: it is the foot of a box, which a detector puts about smoke.
    """

    direction_enu: FloatArray
    sigma_rad: tuple[float, float]
    is_box: bool = False


def has_elevation(numbers: Mapping[str, float]) -> bool:
    """Whether a row may say how high it looks."""
    return "elevation_deg" in numbers or "pitch_deg" in numbers


def aim_of(numbers: Mapping[str, float], texts: Mapping[str, str], config: Config | None) -> Aim:
    """Of a row's numbers and texts by our names; RowError where it lacks something."""
    box = box_of(numbers, texts.get("box"))
    if "bearing_deg" in numbers:
        return replace(_along(numbers["bearing_deg"], numbers), is_box=box is not None)
    if "azimuth_deg" in numbers and box is None:
        return _along(numbers["azimuth_deg"], numbers)
    yaw_deg = numbers.get("yaw_deg", numbers.get("azimuth_deg"))
    if yaw_deg is None or ("pitch_deg" not in numbers and box is None and "u_px" not in numbers):
        raise RowError(
            "lacks a direction: azimuth_deg and elevation_deg, or yaw_deg, pitch_deg, roll_deg, u_px and v_px, "
            "or yaw_deg, hfov_deg and a box"
        )
    camera = _camera(numbers, texts.get("lens", ""), config, box)
    u_px, v_px, sigma_px = _marked(numbers, camera, box)
    attitude = (math.radians(one) for one in (yaw_deg, numbers.get("pitch_deg", 0.0), numbers.get("roll_deg", 0.0)))
    turned = R_cam_from_enu(matrix_from_euler(*attitude), np.eye(3))
    is_bearing = "pitch_deg" not in numbers or (box is not None and box.is_share and "height" not in numbers)
    if is_bearing:
        v_px = camera.cy
    upright_rad = _ANY_ELEVATION_RAD if is_bearing else sigma_px[1] / camera.fy
    return Aim(
        direction_from_pixel(camera, turned, u_px, v_px), (sigma_px[0] / camera.fx, upright_rad), box is not None
    )


def _along(azimuth_deg: float, numbers: Mapping[str, float]) -> Aim:
    elevation_rad = math.radians(numbers.get("elevation_deg", 0.0))
    across_rad = math.radians(numbers.get("azimuth_sigma_deg", 0.0)) * math.cos(elevation_rad)
    upright_rad = math.radians(numbers.get("elevation_sigma_deg", 0.0))
    direction = direction_from_azimuth(math.radians(azimuth_deg), elevation_rad)
    return Aim(direction, (across_rad, upright_rad if "elevation_deg" in numbers else _ANY_ELEVATION_RAD))


def _marked(numbers: Mapping[str, float], camera: Camera, box: Box | None) -> tuple[float, float, tuple[float, float]]:
    """The pixel and one standard deviation of it, across and upright."""
    least_px = numbers.get("sigma_px", _MARKED_PX)
    if box is not None:
        inside = box.in_pixels(camera.width, camera.height)
        across_px, upright_px = inside.foot_sigma
        sigma_px = math.hypot(least_px, across_px), math.hypot(least_px, upright_px)
        u_px, v_px = inside.foot
        v_px = min(v_px, camera.height - 0.5)
    else:
        sigma_px = least_px, least_px
        told = numbers.get("u_px"), numbers.get("v_px")
        if (told[0] is None) is not (told[1] is None):
            raise RowError("has one of u_px and v_px: give both, or neither for the picture's middle")
        u_px = camera.cx if told[0] is None else told[0]
        v_px = camera.cy if told[1] is None else told[1]
    if not (-0.5 <= u_px <= camera.width - 0.5 and -0.5 <= v_px <= camera.height - 0.5):
        name = "the box's foot" if box is not None else "u_px, v_px"
        raise RowError(f"{name} {u_px:g}, {v_px:g}: must lie in the picture of {camera.width} x {camera.height}")
    return u_px, v_px, sigma_px


def _camera(numbers: Mapping[str, float], lens: str, config: Config | None, box: Box | None) -> Camera:
    """Of the row's columns, else of the config."""
    name = lens.strip().lower()
    if name and name not in _FISHEYE and name not in _PINHOLE:
        raise RowError(f"lens {lens!r}: must be rectilinear or fisheye (equidistant)")
    sizes = "width" in numbers and "height" in numbers
    if sizes and all(key in numbers for key in ("fx", "fy", "cx", "cy")):
        fx, fy, cx, cy = (numbers[key] for key in ("fx", "fy", "cx", "cy"))
        return _lens(name, int(numbers["width"]), int(numbers["height"]), (fx, fy), (cx, cy))
    width, height = numbers.get("width"), numbers.get("height")
    if box is not None and box.is_share:
        width, height = width or _SQUARE_PX, height or _SQUARE_PX
    elif box is not None and height is None and width is not None:
        height = max(box.y_max + 1.0, width)
    if width is not None and height is not None and "hfov_deg" in numbers:
        half_rad = 0.5 * math.radians(numbers["hfov_deg"])
        f = 0.5 * width / (half_rad if name in _FISHEYE else math.tan(half_rad))
        return _lens(name, int(width), int(height), (f, f), ((width - 1.0) / 2.0, (height - 1.0) / 2.0))
    if config is None:
        raise RowError("has a yaw and no lens: give width, height and hfov_deg (or fx, fy, cx, cy), or --config FILE")
    try:
        return config.camera.camera()
    except ConfigError as error:
        raise RowError(str(error)) from error


def _lens(name: str, width: int, height: int, focal_px: tuple[float, float], centre_px: tuple[float, float]) -> Camera:
    if name in _FISHEYE:
        return Camera(width, height, *focal_px, *centre_px, distortion=(0.0, 0.0, 0.0, 0.0), model="fisheye")
    return Camera(width, height, *focal_px, *centre_px)
