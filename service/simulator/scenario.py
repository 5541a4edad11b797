"""A simulated flight: who flies where, what burns, how wrong the autopilot is. Used by `demo` and `simulate` only."""

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from distloc.backports import tomllib
from distloc.geometry.geodesy import LocalFrame
from distloc.geometry.rotations import R_ENU_FROM_NED, R_cam_from_enu, heading_rad, matrix_from_euler
from distloc.simulation.landscape.scenes import SCENES
from distloc.simulation.landscape.terrain import RIDGE_FROM_M
from distloc.simulation.paths import FlightPath, VehicleTruth, arc, straight
from distloc.simulation.renderer import Plume
from distloc.types import CameraPose, FloatArray
from service.config.sections import (
    CameraConfig,
    ConfigError,
    Degrees,
    MountConfig,
    NonNegative,
    Positive,
    Section,
    SegmenterConfig,
)

Latitude = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
_ABOVE_HILLS_M = 15.0
Longitude = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]


class OriginSection(Section, frozen=True):
    """Where the scenario's east, north, up are zero: a point of the flat ground."""

    lat_deg: Latitude = 47.4275
    lon_deg: Longitude = 8.6056
    alt_msl_m: float = 430.0
    geoid_m: float = 47.5  # the ellipsoidal height is this much above the height over mean sea level


class PathSection(Section, frozen=True):
    kind: Literal["straight", "arc"] = "straight"
    east_m: float = 0.0
    north_m: float = 0.0
    height_m: Positive = 120.0  # above the origin
    course_deg: Degrees = 0.0  # clockwise from north
    speed_mps: NonNegative = 28.0
    turn_rate_dps: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)] = 0.0  # of an arc, clockwise from above


class PlumeSection(Section, frozen=True):
    """A column of smoke that stands on the ground at (east, north)."""

    east_m: float
    north_m: float
    height_m: Positive = 250.0
    width_m: Positive = 110.0
    wind_east_mps: float = 1.0  # leans it, as Plume says
    wind_north_mps: float = 0.5

    @property
    def plume(self) -> Plume:
        """It as the renderer wants it, grown: its truth does not move."""
        base_enu_m = np.array([self.east_m, self.north_m, 0.0])
        wind_enu_mps = np.array([self.wind_east_mps, self.wind_north_mps, 0.0])
        return Plume(base_enu_m, self.height_m, self.width_m, wind_enu_mps, start_share=1.0)


class ErrorSection(Section, frozen=True):
    """What the estimator of the autopilot gets wrong; biases are one standard deviation, drawn by the seed."""

    heading_bias_deg: NonNegative = 2.0
    tilt_bias_deg: NonNegative = 0.3
    attitude_white_deg: NonNegative = 0.1
    position_sigma_m: NonNegative = 1.5
    latency_ms: tuple[float, float] = (4.0, 18.0)  # of the link, each way


Landscape = Literal["flat", "hills", "mountains", "sea", "night", "snow", "haze", "few_corners", "traffic"]


class FaultSection(Section, frozen=True):
    """How far the camera is from a perfect one."""

    readout_ms: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 0.0  # of a rolling shutter, first row to last
    exposure_ms: Annotated[float, msgspec.Meta(ge=0.0, le=100.0)] = 0.0  # motion blurs over it
    jpeg_quality: Annotated[int, msgspec.Meta(ge=10, le=100)] | None = None  # left out: what each camera has


class Scenario(Section, frozen=True):
    origin: OriginSection = OriginSection()
    path: PathSection = PathSection()
    targets: tuple[PlumeSection, ...] = ()
    camera: CameraConfig = CameraConfig(
        width=1280, height=720, fx=900.0, fy=900.0, cx=640.0, cy=360.0, mount=MountConfig(yaw_deg=-75.0, pitch_deg=-5.0)
    )
    camera_faults: FaultSection = FaultSection()
    landscape: Landscape = "flat"
    errors: ErrorSection = ErrorSection()
    fps: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 5.0
    duration_s: Positive = 60.0
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0

    @property
    def frame(self) -> LocalFrame:
        """The scenario's axes; heights are over mean sea level."""
        return LocalFrame(self.origin.lat_deg, self.origin.lon_deg, self.origin.alt_msl_m)

    @property
    def flight(self) -> FlightPath:
        """The drone's true path."""
        path = self.path
        start_enu_m = np.array([path.east_m, path.north_m, path.height_m])
        course_rad, rate_rps = float(np.radians(path.course_deg)), float(np.radians(path.turn_rate_dps))
        if path.kind == "straight":
            return straight(start_enu_m, course_rad, path.speed_mps)
        radius_m, side = path.speed_mps / abs(rate_rps), float(np.sign(rate_rps))
        right_enu = np.array([np.cos(course_rad), -np.sin(course_rad), 0.0])
        azimuth_rad = course_rad - side * np.pi / 2  # of the start, as seen from the circle's centre
        centre_enu_m = start_enu_m + side * radius_m * right_enu
        return arc(centre_enu_m, radius_m, azimuth_rad, side * path.speed_mps, faces_centre=False)


_WEST = PlumeSection(east_m=-2000.0, north_m=1130.0)
_BUILT_IN = {
    "demo": Scenario(path=PathSection(kind="arc", turn_rate_dps=-0.1), targets=(_WEST,), landscape="hills"),
    "patrol": Scenario(  # round a fire for as long as one likes, always in view: one may join at any time
        path=PathSection(kind="arc", turn_rate_dps=-1.0),
        targets=(PlumeSection(east_m=-1500.0, north_m=100.0),),
        camera=CameraConfig(
            width=640,
            height=360,
            fx=450.0,
            fy=450.0,
            cx=319.5,
            cy=179.5,
            mount=MountConfig(yaw_deg=-90.0, pitch_deg=-5.0),
        ),
    ),
    "two_fires": Scenario(
        targets=(_WEST, PlumeSection(east_m=-2200.0, north_m=2100.0, height_m=200.0, width_m=90.0)),
    ),
    "straight": Scenario(
        targets=(_WEST,),
        errors=ErrorSection(heading_bias_deg=0.0, tilt_bias_deg=0.0, attitude_white_deg=0.05, position_sigma_m=0.5),
    ),
    "hover": Scenario(path=PathSection(speed_mps=0.0), targets=(PlumeSection(east_m=-2000.0, north_m=536.0),)),
}


def load_scenario(name_or_file: str) -> Scenario:
    """A built-in scenario by its name, or one from a TOML file; ConfigError in one line for anything wrong."""
    if name_or_file in _BUILT_IN:
        return _BUILT_IN[name_or_file]
    path = Path(name_or_file)
    if not path.is_file():
        raise ConfigError(f"scenario {name_or_file!r} is neither a file nor one of {', '.join(sorted(_BUILT_IN))}")
    try:
        scenario = msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), Scenario)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not TOML: {error}") from error
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {error}") from error
    _check(path, scenario)
    return scenario


def _check(path: Path, scenario: Scenario) -> None:
    low_ms, high_ms = scenario.errors.latency_ms
    if not 0.0 <= low_ms <= high_ms < 10_000.0:
        raise ConfigError(f"{path}: errors.latency_ms is [{low_ms}, {high_ms}]: it must be two rising times, 0 or more")
    if scenario.path.kind == "arc" and scenario.path.turn_rate_dps * scenario.path.speed_mps == 0.0:
        raise ConfigError(f"{path}: path.turn_rate_dps or path.speed_mps is 0: kind = 'arc' needs both to be another")
    _check_landscape(path, scenario)
    for number, target in enumerate(scenario.targets):
        if not np.isfinite(base_enu_m(target)).all():
            raise ConfigError(f"{path}: targets[{number}] stands at {base_enu_m(target)[:2]}: it must be finite metres")
    if not scenario.targets:
        raise ConfigError(f"{path}: targets is empty: give at least one [[targets]] with east_m and north_m")
    scenario.camera.camera()


def _check_landscape(path: Path, scenario: Scenario) -> None:
    """The flight stays above the hills and this side of the mountains round them."""
    scene, height_m = SCENES[scenario.landscape], scenario.path.height_m
    least_m = scene.hill_height_m + _ABOVE_HILLS_M
    if scene.hill_height_m > 0.0 and height_m < least_m:
        raise ConfigError(
            f"{path}: path.height_m is {height_m}: landscape = '{scenario.landscape}' has hills of"
            f" {scene.hill_height_m:.0f} m: it must be {least_m:.0f} or more"
        )
    flight = scenario.flight
    far_m = max(
        float(np.hypot(*flight.state(t_s).position_enu_m[:2])) for t_s in np.linspace(0.0, scenario.duration_s, 60)
    )
    if scene.ridge_height_m > 0.0 and not far_m <= RIDGE_FROM_M:
        raise ConfigError(
            f"{path}: path leads {far_m:.0f} m from the origin: landscape = '{scenario.landscape}' has mountains from"
            f" {RIDGE_FROM_M:.0f} m on: start nearer, or fly slower or shorter (duration_s)"
        )


def pose_from_truth(scenario: Scenario, truth: VehicleTruth, stamp_s: float) -> CameraPose:
    """The camera's pose for a vehicle's position and attitude."""
    mount = scenario.camera.mount
    R_ned_from_body = matrix_from_euler(truth.yaw_rad, truth.pitch_rad, truth.roll_rad)
    position_enu_m = truth.position_enu_m + R_ENU_FROM_NED @ R_ned_from_body @ mount.lever_arm_body_m
    R = R_cam_from_enu(R_ned_from_body, mount.R_body_from_mount)
    return CameraPose(stamp_s, position_enu_m, R, heading_rad=heading_rad(R_ned_from_body))


def camera_pose(scenario: Scenario, t_s: float, stamp_s: float) -> CameraPose:
    """The camera's true pose `t_s` after take-off, stamped `stamp_s`."""
    return pose_from_truth(scenario, scenario.flight.state(t_s), stamp_s)


def base_enu_m(target: PlumeSection) -> FloatArray:
    """Where the plume stands (3,)."""
    return target.plume.base_enu_m


def centre_enu_m(target: PlumeSection) -> FloatArray:
    """The middle (3,) of the plume's outline."""
    return target.plume.centre_enu_m


def plumes(scenario: Scenario) -> list[Plume]:
    """The targets as the renderer wants them."""
    return [target.plume for target in scenario.targets]


def truth_json(scenario: Scenario) -> dict[str, list[dict[str, Any]]]:
    """The recording's truth.json."""
    frame = scenario.frame

    def place(position_enu_m: FloatArray) -> dict[str, float]:
        lat_deg, lon_deg, alt_msl_m = frame.geodetic_from_enu(position_enu_m)
        return {"lat": round(lat_deg, 9), "lon": round(lon_deg, 9), "alt_msl_m": round(alt_msl_m, 3)}

    return {
        "targets": [
            {"centre": place(centre_enu_m(target)), "base": place(base_enu_m(target)), "size_m": target.height_m}
            for target in scenario.targets
        ]
    }


def service_config_toml(scenario: Scenario, segmenter: SegmenterConfig | None = None) -> str:
    """The text of a config.toml with this camera and mount; the default segmenter unless told otherwise."""
    camera = {name: value for name, value in msgspec.to_builtins(scenario.camera).items() if name != "source"}
    mount = camera.pop("mount")
    segmenting = msgspec.to_builtins(segmenter or SegmenterConfig())
    preprocessing = segmenting.pop("preprocessing")
    tables = {
        "camera": camera,
        "camera.mount": mount,
        "segmenter": segmenting,
        "segmenter.preprocessing": preprocessing,
    }
    return "\n".join(_table(name, values) for name, values in tables.items() if values)


def _table(name: str, values: dict[str, Any]) -> str:
    # JSON's numbers, strings, booleans and flat arrays are TOML as well.
    lines = [f"{key} = {msgspec.json.encode(value).decode()}" for key, value in values.items() if value is not None]
    return "\n".join([f"[{name}]", *lines]) + "\n"
