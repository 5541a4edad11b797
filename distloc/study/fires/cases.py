"""What the study of fires as they are flies: a row a scene, in groups, with its smoke, wind, sources and flight."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from distloc.geometry.camera import Camera
from distloc.study.fires.smoke import SmokeLook

__all__ = ["CAMERA", "CASES", "GROUPS", "SceneCase", "scenes_named"]

Wind = Literal["calm", "toward", "across", "away", "any"]
Motion = Literal["across", "along", "any"]
Layout = Literal["scattered", "in_line"]
Way = Literal["perpendicular", "oblique", "orbit", "lawnmower", "circuits"]

CAMERA = Camera(640, 360, 450.0, 450.0, 319.5, 179.5)
_WAYS: tuple[Way, ...] = ("perpendicular", "oblique", "orbit", "lawnmower")


@dataclass(frozen=True, slots=True)
class SceneCase:
    """One scene. The range is drawn log-uniform by the seed; the ways are flown in turn, by the seed too.

    `fires` are `scattered` within `within_m`, or stand `in_line` as seen from half-way. The wind is as seen from where
    the flight begins; where its side, or the direction of a motion, is open, the seed draws it. `far_things` are clouds
    at tens of kilometres. A fire is lit at `lit_s`; `hidden_m` is the height of trees before it. A flight is
    `length_share` of the range long, or takes `duration_s` where that is above 0. For `border_share` of it the camera
    looks aside, so that the picture's border cuts the root.
    """

    name: str
    group: str
    look: SmokeLook
    wind: Wind = "any"
    wind_mps: float = 5.0
    fires: int = 1
    within_m: float = 0.0
    layout: Layout = "scattered"
    source_mps: float = 0.0
    motion: Motion = "any"
    lit_s: float = float("-inf")
    hidden_m: float = 0.0
    far_things: int = 0
    has_clutter: bool = False
    has_birds: bool = False
    has_dirt: bool = False
    border_share: float = 0.0
    ways: tuple[Way, ...] = _WAYS
    range_m: tuple[float, float] = (1000.0, 2500.0)
    length_share: float = 1.0
    duration_s: float = 0.0
    speed_mps: float = 10.0


_STEADY = SmokeLook(height_m=220.0, life_s=40.0)
_LEANING = SmokeLook(height_m=120.0, life_s=60.0)  # weak: the wind bends it over
_GROWING = SmokeLook(height_m=500.0, life_s=200.0)
_TALL = SmokeLook(height_m=1000.0, life_s=120.0, root_m=30.0, spread=0.06)
_SMALL = SmokeLook(height_m=90.0, life_s=30.0, root_m=8.0)
_DUST = SmokeLook(height_m=20.0, life_s=12.0, root_m=8.0)
_WIDE = SmokeLook(height_m=250.0, life_s=45.0, root_m=25.0)
_FRONT = SmokeLook(height_m=200.0, life_s=40.0, root_m=20.0)
_WINDS: tuple[Wind, ...] = ("calm", "toward", "across", "away")
_AT_2_KM = (2000.0, 2000.0)
_PUFFING = replace(_STEADY, life_s=12.0, height_m=80.0, puffing_s=(15.0, 25.0))


def _standing() -> list[SceneCase]:
    """Steady and growing in four winds, the foot seen and hidden, and puffs."""
    looks = {"steady": (_STEADY, float("-inf")), "growing": (_GROWING, -20.0)}
    cases = [
        SceneCase(f"{name}_{wind}{suffix}", "standing", look, wind=wind, lit_s=lit_s, hidden_m=hidden_m)
        for suffix, hidden_m in (("", 0.0), ("_hidden", 60.0))
        for name, (look, lit_s) in looks.items()
        for wind in _WINDS
    ]
    return cases + [SceneCase(f"puffs_{wind}", "standing", _PUFFING, wind=wind) for wind in ("calm", "across")]


def _moving() -> list[SceneCase]:
    """Dust or a ship that moves, in a picture at half-way wherever it goes."""
    ways: tuple[tuple[Way, float], ...] = (("perpendicular", 0.7), ("orbit", 1.0))
    return [
        SceneCase(
            name=f"mover_{speed_mps:.0f}_{motion}_{way}",
            group="movers",
            look=_DUST,
            wind_mps=2.0,
            source_mps=speed_mps,
            motion=motion,
            ways=(way,),
            range_m=_AT_2_KM,
            length_share=length_share,
        )
        for speed_mps in (5.0, 10.0)
        for motion in ("across", "along")
        for way, length_share in ways
    ]


_CIRCUITS = SceneCase(
    name="circuits",
    group="circuits",
    look=_STEADY,
    wind_mps=3.0,
    fires=3,
    within_m=1200.0,
    has_clutter=True,
    ways=("circuits",),
    range_m=_AT_2_KM,
    duration_s=1200.0,
    speed_mps=15.0,
)
_ROWS = (
    *_standing(),
    *(SceneCase(f"leaning_{wind}", "leaning", _LEANING, wind=wind) for wind in _WINDS[1:]),
    *(
        SceneCase(f"tall_{range_m:.0f}", "cut", replace(_TALL, height_m=height_m), "calm", range_m=(range_m, range_m))
        for height_m, range_m in ((700.0, 1000.0), (1000.0, 1500.0), (1200.0, 2000.0))
    ),
    SceneCase("side", "cut", _WIDE, wind_mps=3.0, border_share=1.0, range_m=(1000.0, 2000.0)),
    SceneCase("side_first_half", "cut", _WIDE, wind_mps=3.0, border_share=0.5, range_m=(1000.0, 2000.0)),
    *(
        SceneCase(
            name=f"unbounded_{count}",
            group="unbounded",
            look=_STEADY,
            wind_mps=2.0,
            lit_s=60.0,
            far_things=count,
            ways=("perpendicular",),
            range_m=_AT_2_KM,
            length_share=1.3,
        )
        for count in (8, 20, 60, 100)
    ),
    *_moving(),
    *(
        SceneCase(
            name=f"front_{speed_mps:g}",
            group="fronts",
            look=_FRONT,
            wind_mps=3.0,
            source_mps=speed_mps,
            ways=("orbit",),
            range_m=(1500.0, 1500.0),
            duration_s=1260.0,
        )
        for speed_mps in (0.2, 0.5, 1.0)
    ),
    *(
        SceneCase(f"dense_{fires}", "dense", _SMALL, wind_mps=2.0, fires=fires, within_m=within_m, range_m=_AT_2_KM)
        for fires, within_m in ((8, 1000.0), (16, 1500.0))
    ),
    SceneCase(
        name="crossing",
        group="crossing",
        look=_STEADY,
        wind_mps=2.0,
        fires=2,
        layout="in_line",
        ways=("perpendicular",),
        range_m=(1500.0, 1500.0),
        length_share=1.3,
    ),
    SceneCase("birds", "beside", _STEADY, wind_mps=3.0, has_birds=True, range_m=_AT_2_KM),
    SceneCase("dirt", "beside", _STEADY, wind_mps=3.0, has_dirt=True, range_m=_AT_2_KM),
    SceneCase("alone", "beside", _STEADY, wind_mps=3.0, range_m=_AT_2_KM),
    _CIRCUITS,
    replace(_CIRCUITS, name="hour", group="hour", duration_s=3600.0),
)
CASES: dict[str, SceneCase] = {case.name: case for case in _ROWS}
GROUPS: dict[str, list[SceneCase]] = {
    group: [case for case in _ROWS if case.group == group] for group in dict.fromkeys(case.group for case in _ROWS)
}


def scenes_named(names: str) -> list[SceneCase]:
    """Those of a list of scenes and groups with commas, in its order and each once; all where it is empty.

    ValueError for another name.
    """
    wanted = [name.strip() for name in names.split(",")] if names.strip() else list(GROUPS)
    if unknown := [name for name in wanted if name not in CASES and name not in GROUPS]:
        raise ValueError(
            f"there is no scene {', '.join(map(repr, unknown))}: "
            f"the groups are {', '.join(GROUPS)}, the scenes {', '.join(CASES)}"
        )
    found: Sequence[SceneCase] = [case for name in wanted for case in GROUPS.get(name) or [CASES[name]]]
    return list({case.name: case for case in found}.values())
