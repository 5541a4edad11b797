"""How the computer fares: load, memory, pressure, heat, disk, from Linux's own files; what is not there is None."""

import contextlib
import os
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

SLICES = 10
MOST_ZONES, MOST_CORES = 16, 64
_FULL_MB = 100.0
_STALL = ("cpu", "memory", "io")
_GPU_LOADS = ("sys/devices/gpu.0/load", "sys/devices/platform/gpu.0/load", "sys/devices/platform/*/*.gpu/load")
_PI_THROTTLED = "sys/devices/platform/soc*/soc*:firmware/get_throttled"
_PI_UNDER_VOLTAGE, _PI_CAPPED, _PI_SOFT_LIMIT = 0x1, 0x2 | 0x4, 0x8  # of what is so now, not of what was


@dataclass(frozen=True, slots=True)
class HostState:
    """Percent, MiB, degrees Celsius. `pressure_percent` is the share of the last 10 s in which something waited (PSI).

    `slices_percent` is the load of all cores in the last slices between two looks, the newest last; `storage_type` is
    MAVLink's number.
    """

    cores_percent: tuple[float, ...] = ()
    slices_percent: tuple[float, ...] = ()
    gpu_percent: float | None = None
    memory_used_mb: float | None = None
    memory_total_mb: float | None = None
    pressure_percent: Mapping[str, float] = field(default_factory=dict)
    temperatures_c: Mapping[str, float] = field(default_factory=dict)
    fans_rpm: tuple[int, ...] = ()
    storage_used_mb: float | None = None
    storage_total_mb: float | None = None
    storage_type: int | None = None
    is_under_voltage: bool = False
    is_cpu_throttled: bool = False
    is_too_hot: bool = False

    @property
    def is_disk_full(self) -> bool:
        """Whether next to nothing is left of the disk that the service writes to."""
        used_mb, total_mb = self.storage_used_mb, self.storage_total_mb
        return used_mb is not None and total_mb is not None and total_mb - used_mb < _FULL_MB


class HostReader:
    """Looks at the files below `root`; the disk is that of `folder`. Called from one thread."""

    def __init__(self, folder: Path, root: Path = Path("/")) -> None:
        self._folder, self._root = folder, root
        self._slices: deque[float] = deque(maxlen=SLICES)
        self._last: dict[str, tuple[int, int]] = {}
        self._last_slice: dict[str, tuple[int, int]] = {}

    def slice(self) -> None:
        """Take the load since the last call: ten times a second."""
        times = dict(self._times(1))
        self._slices.extend(_loads(self._last_slice, times))
        self._last_slice = times

    def state(self) -> HostState:
        """All of it, the cores' loads since the last call: once a second."""
        times = {name: one for name, one in self._times(MOST_CORES + 1) if name != "cpu"}
        loads, self._last = _loads(self._last, times), times
        memory = dict(_pairs(self._text("proc/meminfo"), ":"))
        total_mb, free_mb = _kib(memory.get("MemTotal")), _kib(memory.get("MemAvailable"))
        used_mb, size_mb = self._storage()
        throttled = self._throttled()
        return HostState(
            cores_percent=loads,
            slices_percent=tuple(self._slices),
            gpu_percent=next(self._numbers(_GPU_LOADS, 0.1), None),
            memory_used_mb=None if total_mb is None or free_mb is None else round(total_mb - free_mb, 1),
            memory_total_mb=total_mb,
            pressure_percent=self._pressure(),
            temperatures_c=self._temperatures(),
            fans_rpm=tuple(int(rpm) for rpm in self._numbers(("sys/class/hwmon/hwmon*/fan*_input",), 1.0))[:4],
            storage_used_mb=used_mb,
            storage_total_mb=size_mb,
            storage_type=self._storage_type(),
            is_under_voltage=bool(throttled & _PI_UNDER_VOLTAGE),
            is_cpu_throttled=bool(throttled & _PI_CAPPED),
            is_too_hot=bool(throttled & _PI_SOFT_LIMIT) or self._is_cooled(),
        )

    def _times(self, most: int) -> Iterator[tuple[str, tuple[int, int]]]:
        """(idle, all) in ticks of "cpu", all cores together, then of "cpu0" and so on."""
        for line in self._text("proc/stat").splitlines()[:most]:
            name, *counts = line.split()
            if not name.startswith("cpu"):
                return
            with contextlib.suppress(ValueError, IndexError):
                ticks = [int(one) for one in counts[:8]]  # the guests' are in the user's already
                yield name, (ticks[3] + ticks[4], sum(ticks))

    def _pressure(self) -> dict[str, float]:
        found = {}
        for name in _STALL:
            some = self._text(f"proc/pressure/{name}").partition("\n")[0]
            with contextlib.suppress(ValueError, KeyError):
                found[name] = float(dict(_pairs(some.replace(" ", "\n"), "="))["avg10"])
        return found

    def _temperatures(self) -> dict[str, float]:
        """By the zone's kind; of several of a kind the hottest. A sensor that is off says nothing, or nonsense."""
        found: dict[str, float] = {}
        for zone in sorted(self._root.glob("sys/class/thermal/thermal_zone*"))[:MOST_ZONES]:
            for value in self._numbers((f"{zone.relative_to(self._root)}/temp",), 1e-3):
                if -60.0 < value < 200.0:
                    kind = self._read(zone / "type").strip()[:32] or zone.name
                    found[kind] = max(value, found.get(kind, value))
        return found

    def _throttled(self) -> int:
        """A Raspberry Pi's own word for it, in bits; 0 where nothing is wrong or nobody says."""
        for path in self._root.glob(_PI_THROTTLED):
            with contextlib.suppress(ValueError):
                return int(self._read(path), 16)
        return 0

    def _is_cooled(self) -> bool:
        """Whether the kernel holds a processor's clock down because of heat."""
        for device in sorted(self._root.glob("sys/class/thermal/cooling_device*"))[:MOST_CORES]:
            if "cpu" in self._read(device / "type") and self._read(device / "cur_state").strip() not in ("", "0"):
                return True
        return False

    def _storage(self) -> tuple[float | None, float | None]:
        try:
            found = os.statvfs(self._folder)
        except OSError:
            return None, None
        block_mb = found.f_frsize / 2**20
        return round((found.f_blocks - found.f_bavail) * block_mb, 1), round(found.f_blocks * block_mb, 1)

    def _storage_type(self) -> int | None:
        """0 a disk that turns, 1 an SSD, 2 eMMC, 3 and 4 an SD card that stays or can be taken out."""
        try:
            device = os.stat(self._folder).st_dev
            disk = (self._root / f"sys/dev/block/{os.major(device)}:{os.minor(device)}").resolve(strict=True)
        except OSError:
            return None
        disk = disk if (disk / "queue").is_dir() else disk.parent
        kind = self._read(disk / "device/type").strip()
        if disk.name.startswith("mmcblk") and kind in ("MMC", "SD"):
            return 2 if kind == "MMC" else 4 if self._read(disk / "removable").strip() == "1" else 3
        return {"0": 1, "1": 0}.get(self._read(disk / "queue/rotational").strip())

    def _numbers(self, patterns: tuple[str, ...], factor: float) -> Iterator[float]:
        for pattern in patterns:
            for path in sorted(self._root.glob(pattern)):
                with contextlib.suppress(ValueError):
                    yield float(self._read(path)) * factor

    def _text(self, name: str) -> str:
        return self._read(self._root / name)

    def _read(self, path: Path) -> str:
        try:
            with path.open("rb") as file:
                return file.read(16_384).decode("ascii", "replace")
        except OSError:  # also a sensor that is off
            return ""


def _loads(before: Mapping[str, tuple[int, int]], after: Mapping[str, tuple[int, int]]) -> tuple[float, ...]:
    """Percent in which each was not idle; what has not moved on is left out, and so is one that is new."""
    loads = []
    for name, (idle, total) in after.items():
        if name in before and total > before[name][1]:
            idle_share = (idle - before[name][0]) / (total - before[name][1])
            loads.append(round(100.0 * min(1.0, max(0.0, 1.0 - idle_share)), 1))
    return tuple(loads)


def _pairs(text: str, between: str) -> Iterator[tuple[str, str]]:
    for line in text.splitlines():
        key, found, value = line.partition(between)
        if found:
            yield key.strip(), value.strip()


def _kib(text: str | None) -> float | None:
    """MiB of a line of /proc/meminfo."""
    try:
        return None if text is None else round(int(text.split()[0]) / 1024.0, 1)
    except (ValueError, IndexError):
        return None
