"""Fire fronts: a line where places lie along one, an area where they do not, nothing where it is not sure."""

import numpy as np
import pytest

from distloc.batch.fusion.fronts import fronts
from distloc.types import FloatArray

BOTH = [frozenset({"a"}), frozenset({"b"})]


def found(places: list[tuple[float, float]], sigma_m: float = 20.0, who: int = 2) -> list[tuple[str, tuple[int, ...]]]:
    own = [BOTH[n % who] for n in range(len(places))]
    covariances: FloatArray = np.repeat(sigma_m**2 * np.eye(2)[None], len(places), axis=0)
    return [(one.kind, one.members) for one in fronts(np.array(places), covariances, own)]


def test_places_in_a_row_are_a_line_in_its_order() -> None:
    ((kind, members),) = found([(400.0, 10.0), (0.0, 0.0), (800.0, -10.0), (1_200.0, 5.0)])
    assert kind == "line"
    assert members in ((1, 0, 2, 3), (3, 2, 0, 1))


def test_places_in_a_patch_are_an_area_round_them() -> None:
    ((kind, members),) = found([(0.0, 0.0), (400.0, 0.0), (400.0, 400.0), (0.0, 400.0), (200.0, 200.0)])
    assert kind == "area" and members == (0, 1, 2, 3)


@pytest.mark.parametrize(
    "case",
    [
        {"places": [(0.0, 0.0), (400.0, 0.0)]},  # two fires
        {"places": [(0.0, 0.0), (400.0, 0.0), (800.0, 0.0)], "who": 1},  # one drone alone says so
        {"places": [(0.0, 0.0), (400.0, 0.0), (800.0, 0.0)], "sigma_m": 200.0},  # may be anywhere
        {"places": [(0.0, 0.0), (400.0, 0.0), (1_000.0, 0.0)]},  # too far apart
    ],
)
def test_what_is_not_sure_is_no_front(case: dict) -> None:  # type: ignore[type-arg]
    assert found(**case) == []
