"""What the service loads, before it flies and while it does: each library stays in the drone's memory."""

import subprocess
import sys

import pytest

APP = "import sys, service.flight.app"
# NumPy's sets load its masked arrays when they are first used: 2 MB, and 50 ms in the midst of a step
FLIGHT = """
import sys
import numpy as np
from distloc.localizer import Localizer
from distloc.filter.settings import LocalizerConfig
from distloc.scenery.information import without
from distloc.study.scenes import paper_scene

scene, config = paper_scene(), LocalizerConfig(n_particles=500)
localizer = Localizer(scene.camera, config, rng=np.random.default_rng(0))
for stamp_s in scene.flight.stamps_s[:40]:  # more bearings than are kept
    pose = scene.flight.pose_at(float(stamp_s))
    mask = np.zeros((scene.camera.height, scene.camera.width), np.uint8)
    scene.target.draw(mask, scene.camera, pose)
    localizer.step(pose, mask)
localizer.snapshot()
without(np.eye(4), np.ones(4), np.array([1]))
"""


@pytest.mark.parametrize(("done", "library"), [(APP, "pyproj"), (FLIGHT, "numpy.ma")])
def test_a_flight_loads_no_more_than_it_needs(done: str, library: str) -> None:
    script = f"{done}\nprint({library!r} in sys.modules)"
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert said.stdout == "False\n"
