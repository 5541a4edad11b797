"""A detector's box about smoke: its edges, however they are named, and what of it is a sighting."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from service.recordings.sightings.columns import RowError

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_MOST_TEXT = 10_000
_CORNERS = (
    ("x_min", "y_min", "x_max", "y_max"),
    ("x0", "y0", "x1", "y1"),
    ("x1", "y1", "x2", "y2"),
)  # fmt: skip
_STANDS_AT = 12.0**-0.5  # one standard deviation of anywhere within a length


@dataclass(frozen=True, slots=True)
class Box:
    """In pixels, or in shares of the picture's width and height where `is_share`."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def is_share(self) -> bool:
        """Whether it is told in shares of the picture: a box of pixels is larger than one."""
        return max(self.x_max, self.y_max) <= 1.0

    def in_pixels(self, width: float, height: float) -> "Box":
        """The same in pixels whose centres lie at whole numbers."""
        if not self.is_share:
            return self
        return Box(
            self.x_min * width - 0.5, self.y_min * height - 0.5, self.x_max * width - 0.5, self.y_max * height - 0.5
        )

    @property
    def foot(self) -> tuple[float, float]:
        """The middle of its lower edge: about where the smoke rises from."""
        return 0.5 * (self.x_min + self.x_max), self.y_max

    @property
    def foot_sigma(self) -> tuple[float, float]:
        """One standard deviation of where the smoke rises from: anywhere in its width, near its lower edge."""
        return _STANDS_AT * (self.x_max - self.x_min), 0.1 * (self.y_max - self.y_min)


def box_of(numbers: Mapping[str, float], text: str | None) -> Box | None:
    """A row's box; None where it has none, RowError where it can't be one."""
    if text is not None:
        return _checked(*_most_confident(text))
    for names in _CORNERS:
        if all(name in numbers for name in names):
            return _checked(*(numbers[name] for name in names))
    if "w" not in numbers or "h" not in numbers:
        return None
    w, h = numbers["w"], numbers["h"]
    x, y = numbers.get("x", numbers.get("x_min")), numbers.get("y", numbers.get("y_min"))
    if x is None and "cx" in numbers and "cy" in numbers and "fx" not in numbers:
        x, y = numbers["cx"] - 0.5 * w, numbers["cy"] - 0.5 * h
    if x is None or y is None:
        raise RowError("has a box's w and h and not its upper left corner: give x and y")
    return _checked(x, y, x + w, y + h)


def _checked(x_min: float, y_min: float, x_max: float, y_max: float) -> Box:
    if not (x_min < x_max and y_min < y_max):
        raise RowError(
            f"box {x_min:g}, {y_min:g}, {x_max:g}, {y_max:g}: its right and lower edges must be beyond the others "
            "(v grows downwards; a corner and a size go into x, y, w, h)"
        )
    return Box(x_min, y_min, x_max, y_max)


def _most_confident(text: str) -> tuple[float, float, float, float]:
    """Of `(x_min, y_min, x_max, y_max, confidence), ...` that with the most confidence; one may lack it."""
    values = [float(one) for one in _NUMBER.findall(text[:_MOST_TEXT])]
    if len(values) == 4:
        values.append(1.0)
    if not values or len(values) % 5 or len(text) > _MOST_TEXT:
        raise RowError(f"box {text[:60]!r}: must be x_min, y_min, x_max, y_max, with a confidence where there are more")
    x_min, y_min, x_max, y_max, _ = max((values[i : i + 5] for i in range(0, len(values), 5)), key=lambda one: one[4])
    return x_min, y_min, x_max, y_max
