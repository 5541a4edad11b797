"""What stands on the ground and what drives over it: trees, masts, houses and cars, by place and size."""

from dataclasses import dataclass

import numpy as np

from distloc.simulation.landscape.ground import Ground
from distloc.simulation.landscape.roads import LENGTH_M, Roads
from distloc.simulation.landscape.scenes import Scene
from distloc.simulation.landscape.terrain import Terrain
from distloc.simulation.landscape.texture import of_lists
from distloc.types import BoolArray, FloatArray

CONIFER, BROADLEAF, MAST, LAMP = range(4)
_REACH_M = 5_000.0  # they stand in a square of twice this about the origin
_TRIES = 6  # places drawn for each tree that stands: most lie within a forest, where only its edge's trees are drawn
_CLEAR_M = 60.0  # nothing stands so near to a place that is kept clear
_ROW_GAP_M = 14.0
_TREE_BGR = ((32.0, 54.0, 38.0), (38.0, 68.0, 54.0))
_MAST_BGR, _LAMP_BGR = (190.0, 190.0, 194.0), (150.0, 215.0, 255.0)
_WALLS_BGR = ((206.0, 220.0, 226.0), (176.0, 200.0, 214.0), (150.0, 176.0, 196.0), (228.0, 230.0, 230.0))
_ROOFS_BGR = ((62.0, 78.0, 140.0), (70.0, 74.0, 86.0), (78.0, 104.0, 160.0))
_CARS_BGR = ((236.0, 236.0, 236.0), (40.0, 40.0, 44.0), (44.0, 40.0, 170.0), (150.0, 96.0, 50.0), (150.0, 152.0, 156.0))
_CAR_M = (2.2, 0.95, 1.5)


@dataclass(frozen=True, slots=True)
class Uprights:
    """Bodies of revolution: their feet (3, N), heights, greatest radii, kinds, what their texture is turned by (N,)."""

    base_enu_m: FloatArray
    height_m: FloatArray
    radius_m: FloatArray
    kind: FloatArray
    turn_rad: FloatArray
    bgr: FloatArray


@dataclass(frozen=True, slots=True)
class Boxes:
    """Upright boxes: the middles of their floors (3, N), half length, half width and height (3, N), headings (N,)."""

    base_enu_m: FloatArray
    size_m: FloatArray
    heading_rad: FloatArray
    wall_bgr: FloatArray
    roof_bgr: FloatArray
    has_windows: bool


def uprights(
    scene: Scene, terrain: Terrain, ground: Ground, clear: list[FloatArray], rng: np.random.Generator
) -> Uprights:
    """Trees (single, in rows, at the edges of forests), masts and lamps."""
    area_km2 = (2.0 * _REACH_M / 1000.0) ** 2
    singles = round(scene.trees_km2 * area_km2 / 3.0)
    open_land = _scattered(_TRIES * singles, rng)
    share = of_lists(ground.field_share, *open_land)
    edge = open_land[:, (share > 0.02) & (share < 0.9)][:, :singles]
    alone = open_land[:, share >= 0.9][:, :singles]
    starts = open_land[:, share >= 0.9][:, singles : singles + singles // 9]
    course = rng.uniform(0.0, np.pi, starts.shape[1])
    along = np.arange(9) * _ROW_GAP_M
    ways = np.stack([np.cos(course), np.sin(course)])
    trees = np.hstack([edge, alone, (starts[..., None] + ways[..., None] * along).reshape(2, -1)])
    masts = _scattered(round(scene.masts_km2 * area_km2), rng)
    lamps = _scattered(round(scene.lamps_km2 * area_km2), rng)
    places = np.hstack([trees, masts, lamps])
    n = [trees.shape[1], masts.shape[1], lamps.shape[1]]
    kind = np.repeat([CONIFER, MAST, LAMP], n)
    kind[: n[0]] = np.where(rng.uniform(size=n[0]) < 0.45, CONIFER, BROADLEAF)
    height = np.concatenate([rng.uniform(7.0, 19.0, n[0]), rng.uniform(18.0, 45.0, n[1]), rng.uniform(5.0, 9.0, n[2])])
    slender = np.where(kind == CONIFER, 0.2, 0.36) * rng.uniform(0.85, 1.2, height.size)
    radius = np.where(kind == MAST, 0.45, np.where(kind == LAMP, 0.6, slender * height))
    tint = rng.uniform(0.75, 1.25, (height.size, 1))
    bgr = np.array([*_TREE_BGR, _MAST_BGR, _LAMP_BGR])[kind] * np.where(kind[:, None] <= BROADLEAF, tint, 1.0)
    keep = _is_clear(places, clear)
    standing = _standing(terrain, places)
    turn = rng.uniform(0.0, 2.0 * np.pi, height.size)
    return Uprights(standing[:, keep], height[keep], radius[keep], kind[keep], turn[keep], bgr[keep].T)


def houses(scene: Scene, terrain: Terrain, ground: Ground, clear: list[FloatArray], rng: np.random.Generator) -> Boxes:
    """Houses in hamlets of about five."""
    hamlets = round(scene.houses_km2 * (2.0 * _REACH_M / 1000.0) ** 2 / 5.0)
    tried = _scattered(_TRIES * hamlets, rng)
    middles = np.repeat(tried[:, of_lists(ground.field_share, *tried) > 0.95][:, :hamlets], 5, axis=1)
    n = int(middles.shape[1])
    places = middles + rng.normal(0.0, 38.0, (2, n))
    size = np.stack([rng.uniform(5.0, 10.0, n), rng.uniform(4.0, 6.0, n), rng.uniform(5.0, 9.0, n)])
    walls = np.array(_WALLS_BGR)[rng.integers(0, len(_WALLS_BGR), n)].T
    roofs = np.array(_ROOFS_BGR)[rng.integers(0, len(_ROOFS_BGR), n)].T
    heading = rng.uniform(0.0, np.pi, n)
    keep = _is_clear(places, clear)
    standing = _standing(terrain, places)
    return Boxes(standing[:, keep], size[:, keep], heading[keep], walls[:, keep], roofs[:, keep], True)


class Cars:
    """Cars on the roads, each at its own speed, both ways."""

    def __init__(self, scene: Scene, terrain: Terrain, roads: Roads, rng: np.random.Generator) -> None:
        self._terrain, self._roads = terrain, roads
        lines_m = roads.lines_m()
        n = round(scene.cars_km * LENGTH_M / 1000.0) * len(lines_m) if scene.has_roads else 0
        self._line_m = np.resize(lines_m, n)
        self._start_m = rng.uniform(0.0, LENGTH_M, n)
        self._speed_mps = rng.uniform(11.0, 24.0, n) * rng.choice([-1.0, 1.0], n)
        self._bgr = np.array(_CARS_BGR)[rng.integers(0, len(_CARS_BGR), n)].T

    def at(self, stamp_s: float) -> Boxes:
        """Where they are at a time."""
        east = (self._start_m + self._speed_mps * stamp_s) % LENGTH_M - LENGTH_M / 2.0
        slope = self._roads.slope(east)
        course = np.arctan(slope)  # anticlockwise from east
        side = 1.8 * np.sign(self._speed_mps)  # on the right
        north = self._roads.side_m(east) + self._line_m
        places = np.stack([east + side * np.sin(course), north - side * np.cos(course)])
        size = np.repeat(np.array(_CAR_M)[:, None], east.size, axis=1)
        return Boxes(_standing(self._terrain, places), size, course, self._bgr, 0.9 * self._bgr, False)


def _scattered(n: int, rng: np.random.Generator) -> FloatArray:
    return rng.uniform(-_REACH_M, _REACH_M, (2, n))


def _standing(terrain: Terrain, places: FloatArray) -> FloatArray:
    """Places (2, N) with the ground's height there (3, N)."""
    if places.shape[1] == 0:
        return np.zeros((3, 0))
    return np.vstack([places, of_lists(terrain.height_m, *places)])


def _is_clear(places: FloatArray, clear: list[FloatArray]) -> BoolArray:
    is_clear: BoolArray = np.ones(places.shape[1], bool)
    for one in clear:
        is_clear &= np.hypot(places[0] - one[0], places[1] - one[1]) > _CLEAR_M
    return is_clear
