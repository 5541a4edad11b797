"""docs/examples' programs run as they stand, and draw what the pages show."""

import os
import subprocess
import sys
from pathlib import Path

import cv2

from tests.support.places import ROOT


def test_lookouts_and_a_drone_find_both_fires(tmp_path: Path) -> None:
    picture = tmp_path / "map.png"
    command = [sys.executable, str(ROOT / "docs/examples/lookouts.py"), str(picture)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=tmp_path, env={**os.environ, "MPLBACKEND": "agg"}
    )
    lines = done.stdout.splitlines()
    assert len(lines) == 4 and all(line.endswith("inside") for line in lines)
    drawn, shown = cv2.imread(str(picture)), cv2.imread(str(ROOT / "docs/examples/lookouts.png"))
    assert drawn is not None and shown is not None
    assert abs(drawn.shape[1] - shown.shape[1]) < 20 and drawn.std() > 10.0


def test_the_pages_show_its_picture() -> None:
    for page in ("README.md", "docs/api.md"):
        assert "examples/lookouts.png" in (ROOT / page).read_text(encoding="utf-8")
