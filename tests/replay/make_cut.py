"""Cut a span out of a recording: `make_cut.py RECORDING OUT START_S END_S`, in seconds from the log's start."""

import shutil
import struct
import sys
from pathlib import Path

from service.recordings.tlog import TlogReader

if __name__ == "__main__":
    source, out = Path(sys.argv[1]), Path(sys.argv[2])
    rows = list(TlogReader(source / "telemetry.tlog"))
    start, end = (rows[0][0] + round(float(arg) * 1e6) for arg in sys.argv[3:5])
    (out / "masks").mkdir(parents=True)
    (out / "telemetry.tlog").write_bytes(b"".join(struct.pack(">Q", us) + raw for us, raw in rows if start <= us < end))
    lines = (source / "frames.csv").read_text().splitlines()
    kept = [line for line in lines[1:] if start <= int(line.split(",")[0]) < end]
    (out / "frames.csv").write_text("\n".join([lines[0], *kept]) + "\n")
    for line in kept:
        shutil.copyfile(source / "masks" / (line.split(",")[1] + ".png"), out / "masks" / (line.split(",")[1] + ".png"))
    for name in ("config.toml", "truth.json"):
        shutil.copyfile(source / name, out / name)
