"""What the service loads before it flies: each library stays in the drone's memory."""

import subprocess
import sys

SAY = "import sys, service.flight.app; print('pyproj' in sys.modules)"


def test_a_flight_without_a_dem_loads_no_projections() -> None:
    done = subprocess.run([sys.executable, "-c", SAY], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
