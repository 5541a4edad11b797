"""Where the project and the data beside the checkout are (tests skip what is absent), and how long a wait may be."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CUT = ROOT / "tests" / "replay" / "copter_nominal_cut"
SHARED = ROOT.parent / "shared"  # not part of the project: real logs and frames, the paper
DATA = SHARED / "data"
SITL = DATA / "sitl"

HANG_S = 300.0  # what takes longer hangs: the end of every wait, which no slow or busy machine comes near
