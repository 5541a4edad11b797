"""The config file's sections: frozen structs checked for range, degrees turned to radians at this edge."""

import math
from typing import Annotated, Literal

import msgspec

from distloc.types import PoseErrors
from service.config.camera_section import CameraConfig, MountConfig
from service.config.landmarks import MOST_LANDMARKS, LandmarkConfig
from service.config.section import ConfigError, Degrees, NonNegative, Positive, Section
from service.config.source_section import SourceConfig
from service.config.tak_section import TakConfig

__all__ = [
    "DEM_SIGMA_M",
    "FLAT_SIGMA_M",
    "CameraConfig",
    "Config",
    "ConfigError",
    "Degrees",
    "GroundConfig",
    "KlvConfig",
    "LandmarkConfig",
    "Layout",
    "LinkConfig",
    "LocaliserSection",
    "MavlinkConfig",
    "MountConfig",
    "NonNegative",
    "PoseErrorsConfig",
    "Positive",
    "PositiveDegrees",
    "PreprocessingConfig",
    "RecorderConfig",
    "SceneryConfig",
    "Section",
    "SegmenterConfig",
    "Share",
    "Side",
    "SourceConfig",
    "StateConfig",
    "TakConfig",
    "ZenohConfig",
]

PositiveDegrees = Annotated[float, msgspec.Meta(gt=0.0, le=90.0)]
Rate = Annotated[float, msgspec.Meta(ge=0.1, le=400.0)]  # an autopilot's main loop has 400 a second
SystemId = Annotated[int, msgspec.Meta(ge=1, le=255)]
Sha256 = Annotated[str, msgspec.Meta(pattern=r"^([0-9a-fA-F]{64})?$")]
Share = Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)]
Side = Annotated[int, msgspec.Meta(ge=8, le=8192)]
Layout = Literal["NCHW", "NHWC"]
Polygon = Annotated[tuple[tuple[float, float], ...], msgspec.Meta(min_length=3, max_length=64)]


class LinkConfig(Section, frozen=True):
    url: str
    faces: Literal["autopilot", "ground"] = "autopilot"
    adsb: bool = False  # ADSB_VEHICLE pins for the map; refused on a link that faces an autopilot
    signed: bool = True  # where there is a signing_key; false for a wire that nobody else can reach


class MavlinkConfig(Section, frozen=True):
    links: Annotated[tuple[LinkConfig, ...], msgspec.Meta(max_length=16)] = ()
    target_system: Annotated[int, msgspec.Meta(ge=0, le=255)] = 0  # 0: the first autopilot heard
    attitude_hz: Rate = 50.0
    position_hz: Rate = 20.0
    signing_key: str = ""  # credential:NAME or a file with mode 0600, of 32 bytes or 64 hex digits; empty: unsigned
    command_systems: tuple[SystemId, ...] = (255,)  # whose commands are taken; 255 is what ground control programs are


# Heading, tilt and white attitude errors in degrees, position in metres, the biases' time constant in seconds, and the
# slow error of the position in metres, for the scenery: what the receiver states stands in for it.
# Consumer: a MEMS autopilot with GNSS (1-2 m off the map, 0.3 m frame to frame) and a compass near motors; SITL has
# 0.5 deg of yaw and 0.1 of tilt, a field drone's compass and mount are worse. Survey: the paper's APX-15 has 0.080,
# 0.025 and 0.02-0.05 m, to which a boresight adds that nobody calibrated. Biases live for a minute or two: SITL's yaw
# error keeps 0.64 of itself over 30 s, and on a real copter the headings of EKF and DCM, 2.7 degrees apart, change
# against each other by 1.3 degrees in 10 s, 2.6 in 30 s and 3.4 in 60 s, and by 3.5 in 10 s where it turns. What the
# mount adds does not change, but to take an error for more lasting than it is makes an ellipse too small.
_POSE_ERRORS_OF_GRADE = {"consumer": (2.0, 0.5, 0.1, 1.0, 120.0, 1.5), "survey": (0.3, 0.1, 0.05, 0.05, 120.0, 0.1)}


class PoseErrorsConfig(Section, frozen=True):
    grade: Literal["consumer", "survey"] = "consumer"  # GNSS with compass; dual antenna or RTK
    heading_bias_deg: PositiveDegrees | None = None  # these override the grade's
    tilt_bias_deg: PositiveDegrees | None = None
    attitude_white_deg: PositiveDegrees | None = None
    position_m: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | None = None
    bias_time_constant_s: Annotated[float, msgspec.Meta(ge=0.1, le=1e6)] | None = None
    bias_turn_deg: Annotated[float, msgspec.Meta(ge=0.1, le=1e9)] = 115.0
    position_bias_m: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | None = None

    def pose_errors(self) -> PoseErrors:
        """The grade's sizes with the overrides."""
        heading_deg, tilt_deg, white_deg, position_m, time_constant_s, drift_m = _POSE_ERRORS_OF_GRADE[self.grade]
        return PoseErrors(
            heading_bias_rad=math.radians(self.heading_bias_deg or heading_deg),
            tilt_bias_rad=math.radians(self.tilt_bias_deg or tilt_deg),
            attitude_white_rad=math.radians(self.attitude_white_deg or white_deg),
            position_m=self.position_m or position_m,
            bias_time_constant_s=self.bias_time_constant_s or time_constant_s,
            bias_turn_rad=math.radians(self.bias_turn_deg),
            position_bias_m=self.position_bias_m or drift_m,
        )


class PreprocessingConfig(Section, frozen=True, omit_defaults=True):
    """What a model takes and gives, for one whose metadata (the same keys as `distloc.KEY`) lacks it or is wrong."""

    input_width: Side | None = None
    input_height: Side | None = None
    layout: Layout | None = None
    colour: Literal["RGB", "BGR"] | None = None
    scale: Positive | None = None
    mean: float | tuple[float, ...] | None = None  # one for all channels or three, in the model's colour order
    std: float | tuple[float, ...] | None = None
    output: Literal["logits", "probability", "boxes"] | None = None
    classes: tuple[str, ...] | None = None
    smoke_class: str | None = None
    version: str | None = None
    resize: Literal["stretch", "letterbox", "budget"] | None = None
    multiple: Annotated[int, msgspec.Meta(ge=1, le=1024)] | None = None
    threshold: Share | None = None
    outline_threshold: Share | None = None
    faint_threshold: Share | None = None
    output_name: str | None = None
    output_layout: Layout | None = None
    boxes: Literal["yolov8", "yolov5", "end-to-end"] | None = None


class SegmenterConfig(Section, frozen=True):
    kind: Literal["onnx", "classical", "sobel", "recorded"] = "onnx"
    model: str = ""  # empty: the one that ships, models/smoke-seg.onnx
    sha256: Sha256 = ""  # of the model's file; empty: not checked
    threshold: Share | None = None  # the model's own where not given, else 0.5
    flood_share: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 0.5  # more than this of the frame is a failure
    tiles: Annotated[int, msgspec.Meta(ge=0, le=8)] = 0  # so many rows and columns, each run by itself; 0: none
    tile_overlap: Annotated[float, msgspec.Meta(ge=0.0, le=0.5)] = 0.2  # share of a tile that its neighbour sees too
    providers: tuple[str, ...] = ("TensorrtExecutionProvider", "CUDAExecutionProvider", "CPUExecutionProvider")
    fp16: bool = False  # TensorRT computes with 16 bits: faster; what that costs, `distloc check --model` says
    preprocessing: PreprocessingConfig = PreprocessingConfig()


class LocaliserSection(Section, frozen=True):
    filter: Literal["calibrated", "bootstrap"] = "calibrated"
    n_particles: Annotated[int, msgspec.Meta(ge=100, le=10_000_000)] = 100_000  # at most; calibrated needs 4,096
    particle_sigma_m: Positive = 5.0
    step_distance_m: Annotated[float, msgspec.Meta(ge=0.0, le=10_000.0)] = 10.0
    step_interval_s: Annotated[float, msgspec.Meta(ge=0.0, le=3600.0)] = 1.0
    max_targets: Annotated[int, msgspec.Meta(ge=1, le=64)] = 64
    aim: Literal["centre", "base"] = "base"
    range_m: tuple[float, float] = (50.0, 30_000.0)
    dismissal_misses: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 5
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0


class SceneryConfig(Section, frozen=True):
    """Corners of the scenery that are followed through the frames, and measure what the reported attitude errs by."""

    enabled: bool = True
    corners: Annotated[int, msgspec.Meta(ge=8, le=200)] = 48  # at a time
    window: Annotated[int, msgspec.Meta(ge=6, le=60)] = 25  # keyframes, one for each filter step
    # the craft's own parts in the picture: (u, v) in pixels of the full-size image
    own_parts: Annotated[tuple[Polygon, ...], msgspec.Meta(max_length=16)] = ()


# One standard deviation of the target's aim about the ground. DEM: its own error (SRTM is within 16 m for 90 % by its
# specification, 5 m found on open ground, more where it saw the canopy), 50 m cells on a slope (8 m), the autopilot's
# height (5 m), and that the lowest smoke seen is not at the ground but over trees or a ridge (10 m). A flat world adds
# the relief, which nobody knows here: 30 m is gentle country, hills need more.
DEM_SIGMA_M, FLAT_SIGMA_M = 15.0, 30.0


class GroundConfig(Section, frozen=True):
    kind: Literal["off", "flat", "dem"] = "off"  # the prior on a target's height; flat is at home's altitude
    path: str = ""  # of the DEM: .hgt (or .hgt.zip) or GeoTIFF, or a folder of them
    sigma_m: Annotated[float, msgspec.Meta(gt=0.0, le=10_000.0)] | None = None  # 15 for dem, 30 for flat

    @property
    def height_sigma_m(self) -> float:
        """The kind's own where the key is not given."""
        return self.sigma_m or (DEM_SIGMA_M if self.kind == "dem" else FLAT_SIGMA_M)


class ZenohConfig(Section, frozen=True):
    enabled: bool = True
    mode: Literal["peer", "client"] = "peer"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    ca_certificate: str = ""
    certificate: str = ""
    private_key: str = ""
    user: str = ""
    password_file: str = ""
    users_file: str = ""  # who may connect to `listen`: lines of user:password
    preview: bool = False


class KlvConfig(Section, frozen=True):
    url: str = ""  # udpout:ADDRESS:PORT, where MISB ST 0601 packets of each fire go; empty: nowhere


class RecorderConfig(Section, frozen=True):
    folder: str = ""  # of the flights, a folder for each run; empty: off
    frames: bool = True
    keep_flights: Annotated[int, msgspec.Meta(ge=1, le=100_000)] = 50  # this one counted; older ones are deleted
    least_free_gb: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] = (
        1.0  # below it old flights go, then nothing is written
    )


class AdviceConfig(Section, frozen=True):
    """Where to fly next, for fires that are not sure enough; docs/advice.md."""

    enabled: bool = True
    nose: Literal["course", "target"] = "course"  # of a craft whose camera is fixed: "target" flies sideways as well
    speed_mps: Annotated[float, msgspec.Meta(gt=0.0, le=200.0)] = 10.0
    flight_s: Annotated[float, msgspec.Meta(ge=5.0, le=1800.0)] = 60.0  # the most that a way may take
    enough_m: Annotated[float, msgspec.Meta(ge=0.0, le=100_000.0)] = 100.0  # a shorter half-length is sure enough


class StateConfig(Section, frozen=True):
    dir: str | None = None  # tracks are kept here over a restart; left out: systemd's state directory, if any; "": off
    max_age_s: Annotated[float, msgspec.Meta(gt=0.0, le=86_400.0)] = 600.0  # older ones are not taken up


class Config(Section, frozen=True):
    vehicle: Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")] = "drone1"
    camera: CameraConfig = CameraConfig()
    mavlink: MavlinkConfig = MavlinkConfig()
    pose_errors: PoseErrorsConfig = PoseErrorsConfig()
    segmenter: SegmenterConfig = SegmenterConfig()
    localizer: LocaliserSection = LocaliserSection()
    scenery: SceneryConfig = SceneryConfig()
    landmarks: Annotated[tuple[LandmarkConfig, ...], msgspec.Meta(max_length=MOST_LANDMARKS)] = ()
    ground: GroundConfig = GroundConfig()
    zenoh: ZenohConfig = ZenohConfig()
    tak: TakConfig = TakConfig()
    klv: KlvConfig = KlvConfig()
    recorder: RecorderConfig = RecorderConfig()
    state: StateConfig = StateConfig()
    advice: AdviceConfig = AdviceConfig()
