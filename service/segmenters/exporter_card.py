"""What the exporter of YOLOv8, 11 and later (Ultralytics) writes into its models, as a card's keys; model_card.py asks.

Its names are read as text; nothing of it is evaluated.
"""

import re
from collections.abc import Mapping
from typing import Any

KEYS = ("task", "imgsz", "names", "end2end", "args")
_MASKS_OF = ("detect", "segment")  # the tasks that say where smoke is
_THRESHOLD = 0.25  # its own predictor's
_NAME = re.compile(r"""(\d{1,4}): ('(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*")""")
_MOST_CHARACTERS = 100_000
_SIDES = re.compile(r"\[(\d{1,5}), (\d{1,5})\]")


def exporter_keys(metadata: Mapping[str, str]) -> dict[str, Any]:
    """The keys of a card that follow from its metadata; empty where another made the model.

    Raises ValueError, in one line, for a task that gives no place of smoke that can be used.
    """
    if not all(metadata.get(key) for key in ("task", "imgsz", "names")):
        return {}
    task = metadata["task"]
    if task not in _MASKS_OF:
        why = {
            "obb": "gives boxes that are turned",
            "pose": "gives points of a body",
            "classify": "says whether there is smoke, not where",
        }.get(task, "is none that is known")
        raise ValueError(
            f"it was exported for the task {task!r:.30}, which {why}: train and export a model for detect or segment"
        )
    keys: dict[str, Any] = {
        "layout": "NCHW",
        "colour": "RGB",
        "scale": 1.0 / 255.0,
        "mean": 0.0,
        "std": 1.0,
        "output": "boxes",
        "boxes": "end-to-end" if _has_own_suppression(metadata) else "yolov8",
        "resize": "letterbox",
        "threshold": _THRESHOLD,
    }
    if sides := _SIDES.fullmatch(metadata["imgsz"]):
        keys |= {"input_height": int(sides[1]), "input_width": int(sides[2])}
    if classes := _names(metadata["names"]):
        keys["classes"] = classes
    smoke = [name for name in classes if name.lower() == "smoke"]
    return keys | ({"smoke_class": smoke[0]} if len(smoke) == 1 else {})


def _has_own_suppression(metadata: Mapping[str, str]) -> bool:
    return metadata.get("end2end") == "True" or "'nms': True" in metadata.get("args", "")[:_MOST_CHARACTERS]


def _names(text: str) -> list[str]:
    """The classes in the output's order, of a Python dict as text: {0: 'fire', 1: 'smoke'}."""
    found = {int(number): name[1:-1] for number, name in _NAME.findall(text[:_MOST_CHARACTERS])}
    return [found[number] for number in sorted(found)] if sorted(found) == list(range(len(found))) else []
