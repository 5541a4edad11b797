"""What the page is told, as JSON: the drones and fires of the picture. Every string in it is printable."""

from typing import Literal, NamedTuple

import msgspec

from service.ground.picture.coordinates import PlaceTexts
from service.ground.picture.marks import Mark
from service.publish.parts import AdviceReport, EllipseReport, ExtentReport, Number, PlumeReport


class FireView(msgspec.Struct, frozen=True, kw_only=True):
    """A report as the page shows it; times in seconds since 1970 on the ground's clock, null where not known."""

    id: str
    vehicle: str
    target: int
    epoch: int
    seq: int
    state: str
    aim: str
    lat_deg: Number
    lon_deg: Number
    place: PlaceTexts | None
    altitude_msl_m: Number
    ellipse95: EllipseReport
    region95: EllipseReport
    vertical95_m: Number
    extent_m: ExtentReport
    plume: PlumeReport | None
    range_m: Number
    range95_m: list[Number]
    bearing_deg: Number
    existence: Number
    observations: int
    misses: int
    baseline_m: Number
    attitude: str
    heading_sigma_deg: Number
    motion: str
    advice: AdviceReport | None
    degraded: list[str]
    told_s: float | None
    seen_s: float | None
    first_s: float | None
    mark: Mark | None
    may_be: list[str] = []  # other drones' fires whose ellipses overlap it: perhaps the same
    preview_s: float | None = None  # of the last picture that was taken while it was seen
    first_drone_s: float | None = None  # as first_s, by the drone's own clock: which fire of its number a mark means
    is_earlier: bool = False  # the drone gave its number to another fire since
    fused: str = ""  # the id of the fused fire that it is part of
    outvoted_by: str = ""  # the id of the fire of others that contradict it
    made_of: "FusedView | None" = None  # where it is a fused one


class OutvotedView(msgspec.Struct, frozen=True, kw_only=True):
    """A drone's fire that others contradict, how far off it is and in how many of its own standard deviations."""

    id: str
    vehicle: str
    away_m: float
    sigmas: float


class FusedView(msgspec.Struct, frozen=True, kw_only=True):
    """What a fused fire is made of, by the ids of drones' fires: `undecided` may be of another fire as well.

    `surest` is the one whose height, smoke and advice these are; `larger` is by how much its covariance is larger than
    as told, for how the drones' places scatter.
    """

    contributors: list[str]
    surest: str = ""
    undecided: list[str] = []
    outvoted: list[OutvotedView] = []
    towers: list[str] = []
    larger: float = 1.0


class FrontView(msgspec.Struct, frozen=True, kw_only=True):
    """Fires in a row or a patch: their ids and [lon, lat], along the line or round the area."""

    kind: Literal["line", "area"]
    fires: list[str]
    points: list[tuple[float, float]]


class SectorView(msgspec.Struct, frozen=True, kw_only=True):
    """Where a tower sees smoke, and the id of the fire that it is of, if that is sure."""

    azimuth_deg: float
    opening_deg: float
    told_s: float
    fire: str = ""


class TowerView(msgspec.Struct, frozen=True, kw_only=True):
    """A tower and what it sees; `error_deg` is what its azimuths are found to be too large by, from so many fires."""

    name: str
    lat_deg: float
    lon_deg: float
    altitude_msl_m: Number
    error_deg: float | None
    error_sigma_deg: float | None
    fires: int
    sectors: list[SectorView]


class DroneView(msgspec.Struct, frozen=True, kw_only=True):
    """A drone: where it is, how it is, and what of its messages could not be used."""

    name: str
    is_alive: bool | None
    heard_s: float
    clock_behind_s: Number
    may_be_delay: bool = False  # the link's, and the clock be right: its times are not moved
    state: str
    degraded: list[str]
    says: list[str]
    lat_deg: Number
    lon_deg: Number
    altitude_msl_m: Number
    heading_deg: Number
    footprint: list[list[float]]
    path: list[tuple[float, float]]
    preview_s: float | None
    refused: dict[str, int]
    is_twice: bool


class GroundView(msgspec.Struct, frozen=True, kw_only=True):
    """This ground itself: its links, what it records, whether this is a replay."""

    links: dict[str, bool] = {}
    recorded_s: float | None = None
    record_fault: str = ""
    record_lost: int = 0
    replay: str = ""
    begin_s: float | None = None
    left_out: int = 0
    alerts_refused: dict[str, int] = {}


class Changed(NamedTuple):
    """Fires and drones, by their names, of which there is news."""

    fires: frozenset[str] = frozenset()
    drones: frozenset[str] = frozenset()

    def __bool__(self) -> bool:
        return bool(self.fires or self.drones)

    def also(self, other: "Changed") -> "Changed":
        """Of both."""
        return Changed(self.fires | other.fires, self.drones | other.drones)


class News(msgspec.Struct, frozen=True, kw_only=True):
    """All of it, or what changed since the last one."""

    kind: Literal["all", "news"]
    now_s: float
    fires: list[FireView]
    drones: list[DroneView]
    gone_fires: list[str] = []
    gone_drones: list[str] = []
    towers: list[TowerView] = []
    fronts: list[FrontView] = []
    ground: GroundView
