"""The soak's figures over time: one row a second, in arrays whose size is fixed at the start."""

import io

import numpy as np

from distloc.types import FloatArray

COLUMNS = (
    "t_s",
    "memory_mb",
    "peak_mb",
    "cpu_share",  # of one core
    "threads",
    "frames_hz",  # handed over
    "localised_hz",
    "reports_hz",
    "messages_hz",  # sent
    "targets",  # told of in the last minute and not dismissed
    "latency_p50_ms",  # these three over the ten seconds that end here; empty in the rows between
    "latency_p95_ms",
    "latency_max_ms",
)
MOST_ROWS = 24 * 3600


class Series:
    """Rows beyond the most are dropped."""

    def __init__(self, most_rows: int) -> None:
        self._values = np.full((min(most_rows, MOST_ROWS), len(COLUMNS)), np.nan, np.float32)
        self._rows = 0

    def add(self, **values: float) -> None:
        """The next row; what is not given stays empty."""
        if self._rows < len(self._values):
            for name, value in values.items():
                self._values[self._rows, COLUMNS.index(name)] = value
            self._rows += 1

    def __getitem__(self, name: str) -> FloatArray:
        """A column (N,)."""
        return self._values[: self._rows, COLUMNS.index(name)].astype(np.float64)

    def csv(self) -> bytes:
        """With a header, three decimals, and nothing where there is no value."""
        text = io.StringIO()
        text.write(",".join(COLUMNS) + "\n")
        for row in self._values[: self._rows]:
            text.write(",".join("" if np.isnan(value) else f"{value:.3f}" for value in row) + "\n")
        return text.getvalue().encode()
