"""What the coverage study's classes are called: boxes with errors of the pose, and the scenes of fires as they are."""

from dataclasses import dataclass

from distloc.study.coverage.cases import CoverageCase, coverage_cases, main_cases
from distloc.study.fires.cases import CASES, GROUPS, SceneCase, scenes_named

_BOXES = {"boxes": coverage_cases, "main": main_cases}
_TOO_LONG = "hour"  # a flight of it takes as long as all others together


@dataclass(frozen=True, slots=True)
class Classes:
    """What is flown."""

    boxes: list[CoverageCase]
    scenes: list[SceneCase]


def classes_named(names: str) -> Classes:
    """Those of a list with commas: `boxes`, of these the `main` ones, groups of scenes, scenes.

    All but the hour's where it is empty. ValueError for another name.
    """
    default = ["boxes", *(group for group in GROUPS if group != _TOO_LONG)]
    wanted = [name.strip() for name in names.split(",")] if names.strip() else default
    if unknown := [name for name in wanted if name not in {*_BOXES, *GROUPS, *CASES}]:
        raise ValueError(
            f"there is no class {', '.join(map(repr, unknown))}: there are {', '.join(_BOXES)}, "
            f"the groups of scenes {', '.join(GROUPS)} and the scenes {', '.join(CASES)}"
        )
    boxes = dict.fromkeys(case for name in wanted if name in _BOXES for case in _BOXES[name]())
    scenes = ",".join(name for name in wanted if name not in _BOXES)
    return Classes(list(boxes), scenes_named(scenes) if scenes else [])
