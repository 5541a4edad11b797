"""What stands in for Python 3.11's names on 3.10 is what it stands in for."""

import enum
import runpy
import sys
from typing import Any

import msgspec
import pytest

from tests.support.places import ROOT


@pytest.fixture(params=["of this Python", "of 3.10"])
def StrEnum(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    if request.param == "of 3.10":
        monkeypatch.setattr(sys, "version_info", (3, 10, 12))
    return runpy.run_path(str(ROOT / "distloc/backports.py"))["StrEnum"]


def test_a_member_is_its_text_wherever_it_goes(StrEnum: Any) -> None:
    Reason = StrEnum("Reason", {"NO_FIX": "no_fix", "LATE": "late"})
    assert (str(Reason.LATE), f"{Reason.LATE:>6}", "%s" % Reason.LATE) == ("late", "  late", "late")  # noqa: UP031
    assert {Reason.NO_FIX: 3}["no_fix"] == 3 and Reason.LATE == "late" and sorted(Reason)[0] is Reason.LATE
    assert msgspec.json.encode({Reason.LATE: [Reason.NO_FIX]}) == b'{"late":["no_fix"]}'
    assert msgspec.convert("late", Reason) is Reason.LATE
    assert repr(Reason.LATE) == "<Reason.LATE: 'late'>"


def test_a_member_without_a_text_has_its_name(StrEnum: Any) -> None:
    assert StrEnum("Reason", {"NO_FIX": enum.auto()}).NO_FIX == "no_fix"
