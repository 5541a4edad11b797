"""`study segmentation` by fire: frames of one fire are alike, so the number of fires is what an error bar goes by."""

import re
from collections.abc import Sequence
from typing import Any

from distloc.study.segmentation import ImageScore, share_error, summarised
from service.commands.study.files import rounded

_DAY = re.compile(r"(?:19|20)\d{6}(?=_)")  # as HPWREN's names begin


def fire_of(stem: str) -> str:
    """The day that a frame's name begins with: cameras side by side see one fire; empty where it begins with none."""
    day = _DAY.match(stem)
    return day[0] if day else ""


def by_fire(scored: Sequence[tuple[str, ImageScore]]) -> dict[str, Any]:
    """For the file: a row a fire of what was found, and the standard error of the share found over all of them.

    `scored` has each frame's fire; those without one are left out, and where none has one nothing is said.
    """
    fires: dict[str, list[ImageScore]] = {}
    for fire, score in scored:
        if fire:
            fires.setdefault(fire, []).append(score)
    if not fires:
        return {}
    found = [[one.is_found for one in scores if one.is_smoke] for scores in fires.values()]
    return {
        "fires": [_row(fire, fires[fire]) for fire in sorted(fires)],
        "of_all_fires": _row(f"{len(fires)} fires", [one for scores in fires.values() for one in scores])
        | {"found_share_error": rounded(share_error(found), 4)},
    }


def _row(fire: str, scores: Sequence[ImageScore]) -> dict[str, Any]:
    one = summarised(scores, [])
    return {
        "fire": fire,
        "smoke_images": one.smoke_images,
        "found": sum(score.is_found for score in scores),
        "found_share": rounded(one.found_share, 4),
        "false_per_smoke_image": rounded(one.false_per_smoke_image, 3),
        "negative_images": one.negative_images,
        "false_per_negative": rounded(one.false_per_negative, 3),
    }
