"""Coverage-guided fuzzing, for who has atheris (pip install atheris): python tests/fuzz/guided.py PART [-runs=N ...]

PART is framer, config, frames (frames.csv) or log (telemetry.tlog); what follows goes to libFuzzer: options, and a
folder of inputs to start from.
"""

import random
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[2]))

with atheris.instrument_imports(include=["service", "tests.fuzz", "tomllib", "csv"]):
    from tests.fuzz import targets


def main() -> None:
    folder = Path(tempfile.mkdtemp())
    link, flight = targets.Link(), targets.Flight()
    parts: dict[str, Callable[[bytes], object]] = {
        "framer": lambda data: link.feed(random.Random(len(data)), data),
        "config": lambda data: targets.config(folder, data),
        "frames": lambda data: targets.recording(folder, {**flight.files, "frames.csv": b"stamp_us,file\n" + data}),
        "log": lambda data: targets.recording(folder, {**flight.files, "telemetry.tlog": data}),
    }
    atheris.Setup([sys.argv[0], *sys.argv[2:]], parts[sys.argv[1]])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
