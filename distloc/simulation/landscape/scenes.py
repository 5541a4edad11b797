"""The landscapes by name: how hilly, what stands there, what moves, the light and the air."""

from dataclasses import dataclass, replace

__all__ = ["SCENES", "Scene"]

Bgr = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Scene:
    """What a landscape is made of; lengths in metres, densities a square kilometre, colours BGR of 0 to 255.

    `contrast` scales all texture of the ground; `light` all that is lit by the sky, after the haze.
    """

    hill_height_m: float = 85.0
    ridge_height_m: float = 150.0
    trees_km2: float = 170.0
    houses_km2: float = 6.0
    masts_km2: float = 0.7
    has_roads: bool = True
    cars_km: float = 3.0
    cloud_shadow: float = 0.0  # the share of the light that a shadow takes
    cloud_cover: float = 0.35
    wind_mps: float = 7.0  # of the clouds and their shadows
    is_sea: bool = False
    contrast: float = 1.0
    forest_bgr: Bgr = (42.0, 66.0, 50.0)
    field_bgr: Bgr = (66.0, 104.0, 96.0)
    haze_bgr: Bgr = (222.0, 212.0, 200.0)
    zenith_bgr: Bgr = (205.0, 150.0, 95.0)
    haze_range_m: float = 6_500.0
    land_haze: float = 0.93  # how bright far land is beside the sky at the horizon
    light: float = 1.0
    lamps_km2: float = 0.0
    noise: float = 1.6  # of the sensor, one standard deviation in grey levels


_HILLS = Scene()
SCENES: dict[str, Scene] = {
    "flat": replace(
        _HILLS, hill_height_m=0.0, ridge_height_m=0.0, trees_km2=0.0, houses_km2=0.0, masts_km2=0.0, has_roads=False,
        cars_km=0.0, cloud_cover=0.0,
    ),
    "hills": _HILLS,
    "mountains": replace(_HILLS, ridge_height_m=420.0),  # as high as a plume: it hardly stands out before them
    "sea": replace(
        _HILLS, hill_height_m=0.0, ridge_height_m=0.0, trees_km2=0.0, houses_km2=0.0, masts_km2=0.0, has_roads=False,
        cars_km=0.0, is_sea=True, forest_bgr=(84.0, 66.0, 38.0), field_bgr=(150.0, 128.0, 96.0),
    ),
    "night": replace(_HILLS, light=0.12, noise=5.0, lamps_km2=14.0, cloud_cover=0.0),
    "snow": replace(
        _HILLS, contrast=0.06, forest_bgr=(226.0, 220.0, 216.0), field_bgr=(240.0, 236.0, 233.0), trees_km2=6.0,
        houses_km2=0.5, has_roads=False, cars_km=0.0, zenith_bgr=(222.0, 205.0, 190.0), cloud_cover=0.0,
    ),
    "haze": replace(_HILLS, haze_range_m=500.0, land_haze=0.99, cloud_cover=0.0),
    "few_corners": replace(
        _HILLS, hill_height_m=25.0, contrast=0.09, trees_km2=2.0, houses_km2=0.0, masts_km2=0.0, has_roads=False,
        cars_km=0.0, forest_bgr=(62.0, 100.0, 88.0),
    ),
    "traffic": replace(_HILLS, cars_km=40.0, cloud_shadow=0.45, wind_mps=12.0, cloud_cover=0.5),
}  # fmt: skip
