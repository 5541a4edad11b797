"""`study segmentation`'s tables on the screen; run.py says them."""

from collections.abc import Mapping, Sequence
from typing import Any

from service.commands.study.files import cell


def by_folder_text(rows: Sequence[dict[str, Any]], segmenter: str) -> str:
    """The table by folder on the screen, and what its columns mean."""
    width = max(len("folder"), *(len(row["folder"]) for row in rows)) + 1
    head = (
        f"{'folder':{width}}{'smoke':>6}{'found':>7}{'IoU':>7}{'prec.':>7}{'recall':>7}{'centre px':>10}{'base px':>9}"
        f"{'false':>7}{'without':>9}{'false':>7}{'ms':>8}  left out"
    )
    return "\n".join(
        [
            f"segmenter: {segmenter}",
            head,
            *(_line(row, width) for row in rows),
            "",
            "found: a segment's centroid lies on the smoke or beside it (10 px at a width of 512); centre, base: its",
            "error's median in pixels; false: segments an image on no smoke, in images with smoke and without;",
            "IoU, precision and recall are means over the images with masks; left out: refused by the segmenter (no",
            "segments), or unreadable (not counted)",
        ]
    )


def _line(row: dict[str, Any], width: int) -> str:
    refused = [f"{count} {reason}" for reason, count in row["rejected"].items()]
    left_out = refused + ([f"{row['unreadable']} unreadable"] if row["unreadable"] else [])
    return (
        f"{row['folder']:{width}}{row['smoke_images']:>6}{cell(row['found_share'], 7, 2)}{cell(row['iou_mean'], 7, 3)}"
        f"{cell(row['precision'], 7, 3)}{cell(row['recall'], 7, 3)}{cell(row['centroid_error_px_median'], 10, 1)}"
        f"{cell(row['base_error_px_median'], 9, 1)}{cell(row['false_per_smoke_image'], 7, 2)}"
        f"{row['negative_images']:>9}{cell(row['false_per_negative'], 7, 2)}{cell(row['ms_median'], 8, 1)}"
        f"  {', '.join(left_out) or '-'}"
    )


def by_fire_text(content: Mapping[str, Any]) -> str:
    """The table by fire on the screen: what `by_fire` gave."""
    whole = content["of_all_fires"]
    lines = [f"{'fire':<10}{'smoke':>6}{'found':>7}{'':>6}{'false':>7}{'without':>9}{'false':>7}"]
    lines += [_fire_line(row) for row in [*content["fires"], whole]]
    if whole["found_share_error"] is not None:
        lines[-1] += f"   found {whole['found_share']:.2f} +- {whole['found_share_error']:.2f}, by the spread of fires"
    return "\n".join(lines)


def _fire_line(row: Mapping[str, Any]) -> str:
    return (
        f"{row['fire']:<10}{row['smoke_images']:>6}{row['found']:>7}{cell(row['found_share'], 6, 2)}"
        f"{cell(row['false_per_smoke_image'], 7, 2)}{row['negative_images']:>9}{cell(row['false_per_negative'], 7, 2)}"
    )
