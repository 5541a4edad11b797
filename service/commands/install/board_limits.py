"""CPUQuota and memory limits that follow the board's size; `distloc install` puts them into the unit."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

_LEAST_MB, _USUAL_MB = 320, 1024  # the service needs 200 MB with the shipped model on the CPU
_LEAST_GPU_MB, _MOST_GPU_MB = 1024, 6144  # a GPU's libraries, and an engine under construction


@dataclass(frozen=True, slots=True)
class Board:
    """Cores, and memory in MiB as Linux sees it: a GPU's share that is set aside is not in it."""

    cores: int
    memory_mb: int


def read_board(meminfo: Path = Path("/proc/meminfo")) -> Board | None:
    """This computer; None where it does not say."""
    try:
        found = re.search(r"^MemTotal:\s+(\d+) kB$", meminfo.read_text(encoding="ascii"), re.M)
    except (OSError, UnicodeDecodeError):
        return None
    cores = os.cpu_count()
    return Board(cores, int(found[1]) // 1024) if found and cores else None


def cpu_quota_percent(board: Board) -> int:
    """All cores but one, which is the autopilot's router's and the ground link's; of two half of that one as well."""
    return {1: 90, 2: 150}.get(board.cores, 100 * (board.cores - 1))


def memory_max_mb(board: Board, has_gpu: bool) -> int:
    """Half of the board's, as much as is ever needed at the most; with a GPU, whose memory is the board's own, 60 %."""
    if has_gpu:
        return min(_MOST_GPU_MB, max(_LEAST_GPU_MB, board.memory_mb * 6 // 10))
    return min(_USUAL_MB, max(_LEAST_MB, board.memory_mb // 2))


def limited(unit: bytes, board: Board, has_gpu: bool) -> bytes:
    """A unit, or a drop-in, with the limits that it has set to the board's; one that has none stays as it is."""
    most_mb = memory_max_mb(board, has_gpu)
    values = {
        "CPUQuota": f"{cpu_quota_percent(board)}%",
        "MemoryHigh": f"{most_mb * 3 // 4}M",
        "MemoryMax": f"{most_mb}M",
    }
    for key, value in values.items():
        unit = re.sub(rf"^{key}=.*$".encode(), f"{key}={value}".encode(), unit, flags=re.M)
    return unit
