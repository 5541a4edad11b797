"""docs/api.md's programs run as they stand, and `import distloc` brings all that it names, quickly."""

import re
import subprocess
import sys

import pytest

import distloc
from tests.support.places import ROOT

PROGRAMS = re.findall(r"^## (.+?)\n.*?```python\n(.*?)```", (ROOT / "docs/api.md").read_text("utf-8"), re.DOTALL | re.M)
PRINTS = {
    "Own masks": "confirmed: 47.01",
    "Own detections": "confirmed",
    "Sightings in a batch": "47.0",
    "A live loop": "sightings; lacks",
}


def test_there_are_four_programs() -> None:
    assert [title for title, _ in PROGRAMS] == list(PRINTS)


@pytest.mark.parametrize(("title", "program"), PROGRAMS, ids=[title for title, _ in PROGRAMS])
def test_a_program_runs(title: str, program: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(program, title, "exec"), {"__name__": "example"})
    assert PRINTS[title] in capsys.readouterr().out


def test_every_exported_name_is_there() -> None:
    assert len(set(distloc.__all__)) == len(distloc.__all__)
    for name in distloc.__all__:
        assert getattr(distloc, name) is not None
    assert set(distloc.__all__) <= set(dir(distloc))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = distloc.nothing


def test_the_package_says_that_it_is_typed() -> None:
    assert (ROOT / "distloc/py.typed").exists()


def test_import_loads_nothing_heavy() -> None:
    code = "import sys, distloc; print(sorted({'numpy', 'cv2', 'distloc.localizer'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
