"""ONBOARD_COMPUTER_STATUS from how the computer fares, as docs/mavlink.md says; what is not known is unused."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.common.host import HostState

_NONE8, _NONE_C, _NONE16, _NONE32 = 0xFF, 127, 0x7FFF, 0xFFFFFFFF  # MAVLink's "the field is unused"
_HOTTEST_C = 126.0
_BOARD = ("board", "tdiode", "acpitz")  # of the zones' kinds: Jetson's and PCs'
_PRIMARY = 0


def onboard_computer_status(host: HostState, now_ns: int) -> Any:
    """The message; `now_ns` is since the computer's own start."""
    cores = [_percent(load) for load in host.cores_percent]
    zones = {kind.lower(): value for kind, value in host.temperatures_c.items()}
    board = [value for kind, value in zones.items() if any(word in kind for word in _BOARD)]
    flags = (
        mavlink.COMPUTER_STATUS_FLAGS_UNDER_VOLTAGE * host.is_under_voltage
        | mavlink.COMPUTER_STATUS_FLAGS_CPU_THROTTLE * host.is_cpu_throttled
        | mavlink.COMPUTER_STATUS_FLAGS_THERMAL_THROTTLE * host.is_too_hot
        | mavlink.COMPUTER_STATUS_FLAGS_DISK_FULL * host.is_disk_full
    )
    gpu = [] if host.gpu_percent is None else [_percent(host.gpu_percent)]
    return mavlink.MAVLink_onboard_computer_status_message(
        time_usec=now_ns // 1000,
        uptime=now_ns // 1_000_000 & 0xFFFFFFFF,
        type=_PRIMARY,
        cpu_cores=_filled(cores, 8, _NONE8),
        cpu_combined=_filled([_percent(load) for load in host.slices_percent], 10, _NONE8),
        gpu_cores=_filled(gpu, 4, _NONE8),
        gpu_combined=_filled([], 10, _NONE8),
        temperature_board=_celsius(max(board)) if board else _NONE_C,
        temperature_core=_filled([_celsius(value) for kind, value in zones.items() if "cpu" in kind], 8, _NONE_C),
        fan_speed=_filled([min(rpm, _NONE16 - 1) for rpm in host.fans_rpm], 4, _NONE16),
        ram_usage=_mib(host.memory_used_mb),
        ram_total=_mib(host.memory_total_mb),
        storage_type=_filled([] if host.storage_type is None else [host.storage_type], 4, _NONE32),
        storage_usage=_filled([_mib(host.storage_used_mb)], 4, _NONE32),
        storage_total=_filled([_mib(host.storage_total_mb)], 4, _NONE32),
        link_type=[_NONE32] * 6,
        link_tx_rate=[_NONE32] * 6,
        link_rx_rate=[_NONE32] * 6,
        link_tx_max=[_NONE32] * 6,
        link_rx_max=[_NONE32] * 6,
        status_flags=int(flags),
    )


def _filled(values: list[int], size: int, unused: int) -> list[int]:
    return (values + [unused] * size)[:size]


def _percent(load: float) -> int:
    return round(min(100.0, max(0.0, load))) if math.isfinite(load) else _NONE8


def _celsius(value: float) -> int:
    return round(min(_HOTTEST_C, max(-128.0, value)))


def _mib(value_mb: float | None) -> int:
    return _NONE32 if value_mb is None else min(_NONE32 - 1, max(0, round(value_mb)))
