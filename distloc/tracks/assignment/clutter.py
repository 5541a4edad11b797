"""How dense false segments lie; the assignment asks."""

from distloc.geometry.camera import Camera

CLUTTER_DENSITY = 1.0  # false segments expected in a frame, for each unit of tangent squared: about one in the image
_LATELY = 0.1  # of what the last frame says


class Clutter:
    """How dense false segments lie, as the frames of late show it: in a flood of them a match must be closer.

    Otherwise segments that have nothing to do with each other pass for one thing, near by, that was seen often.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self._image = camera.width / camera.fx * camera.height / camera.fy
        self._number = 0.0  # in a frame

    @property
    def density(self) -> float:
        """By tangent squared, at the least what one in the image is."""
        return max(CLUTTER_DENSITY, self._number / self._image)

    def learn(self, number: int) -> None:
        """So many segments of a frame belong to nothing that was seen often."""
        self._number += _LATELY * (number - self._number)
