"""What particles cost before any target has them."""

import os
import subprocess
import sys

import pytest

A_PLACE = (3 + 5 + 1) * 4096 * 4  # bytes: position, nuisances, weight
# in a process of its own, whose memory nobody used before
ASKED = """
import os
import numpy as np
from distloc.filter.particles import Particles

def resident_bytes():
    with open("/proc/self/statm", encoding="ascii") as told:
        return int(told.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

before = resident_bytes()
particles = Particles(400, 4096, [np.random.default_rng(0)] * 400)
particles.write(32)
print(resident_bytes() - before)
particles.x.fill(1.0)
print(resident_bytes() - before)
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="asks Linux")
def test_only_the_places_that_are_written_are_in_memory() -> None:
    told = subprocess.run([sys.executable, "-c", ASKED], capture_output=True, text=True, check=True)
    written, filled = map(int, told.stdout.split())
    assert written < 100 * A_PLACE
    assert filled > 2 * written
