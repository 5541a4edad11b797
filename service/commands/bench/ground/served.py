"""`distloc ground` as a process of its own, as its unit starts it, and what /proc says that it takes."""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Self

from service.commands.install.unit_environment import unit_environment

_END_S = 15.0


class Served:
    """Listens for drones at `endpoint` and records to `folder`; `address` is its page. RuntimeError where it ends."""

    def __init__(self, endpoint: str, folder: Path) -> None:
        options = ("--port", "0", "--listen", endpoint, "--record", str(folder))
        self._process = subprocess.Popen(
            [sys.executable, "-m", "service", "ground", *options],
            env=os.environ | unit_environment(),
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        self.address = f"http{line.strip().partition('http')[2]}"
        if "http" not in line:
            self._end()
            raise RuntimeError(f"distloc ground ended with {self._process.returncode}")

    def cpu_s(self) -> float:
        """Seconds of a core until now."""
        fields = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def rss_mb(self, which: str = "VmRSS") -> float:
        """Memory now, or VmHWM's most."""
        status = Path(f"/proc/{self._process.pid}/status").read_text(encoding="ascii")
        return int(status.partition(f"{which}:")[2].split()[0]) * 1024e-6

    def rest(self, seconds: float) -> None:
        """Let it serve for so long."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            time.sleep(min(left_s, 1.0))
            if self._process.poll() is not None:
                raise RuntimeError(f"distloc ground ended with {self._process.returncode}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _end(self) -> None:
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
