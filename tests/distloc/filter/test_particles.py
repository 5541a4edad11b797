"""What particles cost before any target has them."""

import os

import numpy as np
import pytest

from distloc.filter.particles import Particles

PLACES, N = 400, 4096
A_PLACE = (3 + 5 + 1) * N * 4  # bytes: position, nuisances, weight


def resident_bytes() -> int:
    with open("/proc/self/statm", encoding="ascii") as told:
        return int(told.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="asks Linux")
def test_only_the_places_that_are_written_are_in_memory() -> None:
    before = resident_bytes()
    particles = Particles(PLACES, N, [np.random.default_rng(0)] * PLACES)
    particles.write(32)
    written = resident_bytes() - before
    assert written < 100 * A_PLACE
    particles.x.fill(0.0)
    assert resident_bytes() - before > 300 * (A_PLACE - 4 * N)
