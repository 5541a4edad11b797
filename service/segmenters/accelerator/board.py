"""What computer this is, as far as a GPU goes: its nodes, its name, the versions that an engine is built for."""

import contextlib
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path("/")
_NODES = ("dev/nvidia[0-9]*", "dev/nvhost-gpu", "dev/nvhost-ctrl-gpu", "dev/nvgpu*", "dev/nvmap")
_TREE = "proc/device-tree"
_INFER = ("usr/lib/*-linux-gnu/libnvinfer.so.*", "usr/local/*/lib*/libnvinfer.so.*")


def gpu_nodes(root: Path = ROOT) -> list[Path]:
    """The devices of an NVIDIA GPU, a card's or a Jetson's own; none where there is no such GPU or no driver."""
    return sorted({node for pattern in _NODES for node in root.glob(pattern)})


def is_jetson(root: Path = ROOT) -> bool:
    """Whether the device tree says Tegra."""
    return b"nvidia,tegra" in _bytes(root / _TREE / "compatible")


def board_name(root: Path = ROOT) -> str:
    """The board's model, or the card's, or else the processor's kind."""
    if model := _text(root / _TREE / "model"):
        return model
    cards = sorted(root.glob("proc/driver/nvidia/gpus/*/information"))
    models = (line.partition(":")[2].strip() for path in cards for line in _text(path).splitlines() if "Model" in line)
    return next(models, "") or platform.machine()


def driver(root: Path = ROOT) -> str:
    """The GPU driver's version in its own words; a Jetson's is that of its whole system."""
    return _first_line((root / "etc/nv_tegra_release", root / "proc/driver/nvidia/version")) or "unknown"


def tensorrt_version(root: Path = ROOT) -> str:
    """TensorRT's, by its library's name, or its Python package's; "unknown" where neither is found."""
    found = {path.resolve().name.partition(".so.")[2] for pattern in _INFER for path in root.glob(pattern)}
    with contextlib.suppress(PackageNotFoundError):
        found.add(version("tensorrt"))
    return ", ".join(sorted(found - {""})) or "unknown"


def _first_line(paths: Iterable[Path]) -> str:
    return next((line for path in paths for line in _text(path).splitlines() if line.strip()), "")


def _text(path: Path) -> str:
    return _bytes(path).decode("utf-8", "replace").strip("\0 \n")


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(4096)
    except OSError:
        return b""
