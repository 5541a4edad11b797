"""Where a drone flew: a bounded way that gets coarser with its length."""

MOST_POINTS = 400
_LEAST_STEP_DEG = 0.0001  # 11 m


class Path:
    """[lon, lat] points; when full, every other one of the older half goes."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float]] = []

    def add(self, lon_deg: float, lat_deg: float) -> None:
        """The newest place; one that is within 10 m of the last is left out."""
        if self.points and all(
            abs(new - old) < _LEAST_STEP_DEG for new, old in zip((lon_deg, lat_deg), self.points[-1], strict=True)
        ):
            return
        self.points.append((lon_deg, lat_deg))
        if len(self.points) > MOST_POINTS:
            half = MOST_POINTS // 2
            self.points = self.points[:half:2] + self.points[half:]
