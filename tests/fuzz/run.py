"""A long run of the fuzzing: python tests/fuzz/run.py --framer 1000000 --configs 100000 --recordings 100000.

Prints for each part how many inputs were taken, the slowest, and the memory before and after. An input that raises is
written to fuzz-failure.txt with its seed, and the exit code is 1; one that takes over 60 s is a hang and ends the run
with a traceback.
"""

import argparse
import contextlib
import ctypes
import faulthandler
import gc
import random
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.fuzz import targets
from tests.fuzz.mutations import stream

HANG_S = 60
RESTART_SHARE = 0.001  # of a link's inputs that meet one that has heard nothing yet
WARM_UP_SHARE = 0.1  # caches and pools fill first; memory is compared from there


def rss_mb() -> float:
    """Resident memory of this process, less what the allocator holds back: that grows with no leak behind it."""
    gc.collect()
    with contextlib.suppress(AttributeError):  # not glibc's
        ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def fuzzed(name: str, count: int, seed: int, one: Callable[[random.Random], object]) -> bool:
    """Run a target `count` times, each with a generator of its own; True if nothing was wrong."""
    warm_up, before_mb = int(count * WARM_UP_SHARE), rss_mb()
    slowest_s, taken, start_s = 0.0, 0, time.monotonic()
    for number in range(count):
        if number == warm_up:
            before_mb = rss_mb()
        faulthandler.dump_traceback_later(HANG_S, exit=True)
        at_s = time.monotonic()
        try:
            taken += one(random.Random(f"{seed}/{name}/{number}")) is not None
        except Exception:
            Path("fuzz-failure.txt").write_text(f"{seed}/{name}/{number}\n{traceback.format_exc()}")
            traceback.print_exc()
            print(f"{name}: input {number} of seed {seed} failed")
            return False
        slowest_s = max(slowest_s, time.monotonic() - at_s)
    faulthandler.cancel_dump_traceback_later()
    took_s = time.monotonic() - start_s
    print(
        f"{name}: {count} inputs, {taken} taken, in {took_s:.0f} s, the slowest {1000 * slowest_s:.0f} ms, "
        f"memory {before_mb:.1f} -> {rss_mb():.1f} MB",
        flush=True,
    )
    return True


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("framer", "links", "configs", "recordings", "cards", "states"):
        parser.add_argument(f"--{name}", type=int, default=0, help=f"how many inputs for the {name}")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("error")  # numpy's on numbers that are none: they should have been refused
    links, junk, flight = [targets.Link()], targets.Link(), targets.Flight()
    kept = targets.State()

    def feed(rng: random.Random) -> object:
        if rng.random() < RESTART_SHARE:
            links[0] = targets.Link()
        return links[0].feed(rng, stream(rng))

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts: dict[str, Callable[[random.Random], object]] = {
            "framer": lambda rng: junk.feed(rng, rng.randbytes(rng.randint(0, 120))),
            "links": feed,
            "configs": lambda rng: targets.config(folder, targets.harmed_config(rng)),
            "recordings": lambda rng: targets.recording(folder, flight.harmed(rng)),
            "cards": lambda rng: targets.card(targets.harmed_card(rng)) or None,
            "states": lambda rng: targets.state(kept.harmed(rng)),
        }
        results = [fuzzed(part, getattr(options, part), options.seed, one) for part, one in parts.items()]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
