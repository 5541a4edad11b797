"""What is set before NumPy is loaded, for whoever imports the service first."""

import os
import subprocess
import sys

import pytest

SAY = "import service, numpy, os; print(os.environ['OPENBLAS_NUM_THREADS'], len(os.listdir('/proc/self/task')))"


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="counts the threads that Linux names")
@pytest.mark.parametrize(("told", "said"), [(None, "1 1\n"), ("2", "2 2\n")])
def test_openblas_starts_no_thread_unless_told_to(told: str | None, said: str) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    if told is not None:
        environment["OPENBLAS_NUM_THREADS"] = told
    done = subprocess.run([sys.executable, "-c", SAY], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == said or (told and len(os.sched_getaffinity(0)) == 1)
