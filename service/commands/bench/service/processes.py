"""The simulated autopilot as a process of its own, while the pipeline is measured."""

import contextlib
import socket
import subprocess
import sys
from collections.abc import Iterator

_END_S = 10.0


@contextlib.contextmanager
def autopilot_of(scenario: str, port: int, start_ns: int) -> Iterator[None]:
    """A simulated autopilot flies a built-in scenario, on a UDP socket, while the block runs."""
    command = [
        sys.executable, "-m", "service.simulator.simulated_autopilot", "--scenario", scenario,
        "--connect", f"127.0.0.1:{port}", "--start-monotonic-ns", str(start_ns), "--seed", "0",
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.terminate()
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()


def free_port(kind: socket.SocketKind) -> int:
    """One that nobody has just now, on loopback."""
    with socket.socket(socket.AF_INET, kind) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])
