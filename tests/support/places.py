"""Where the project, its recorded flight and the data beside the checkout are; tests skip what is absent."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CUT = ROOT / "tests" / "replay" / "copter_nominal_cut"
SHARED = ROOT.parent / "shared"  # not part of the project: real logs and frames, the paper
DATA = SHARED / "data"
SITL = DATA / "sitl"
