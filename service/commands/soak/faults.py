"""The faults that a soak puts into the running service: how each begins and ends, and when all was well again."""

import contextlib
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from service.commands.soak.schedule import PlannedFault
from service.commands.soak.supervisor import Child
from service.recordings.flights import flights_in
from service.simulator.craft import CraftOnAir, junk
from service.simulator.operator import Operator

JUNK_SHARE = 0.3
OTHER_SYSTEM = 2
JUMP_ENU_M = (45.0, -40.0, 3.0)
HEADING_JUMP_RAD = 0.21
WRONG_SIZE = (300, 200)  # no whole fraction of the camera's


@dataclass(frozen=True, slots=True)
class Rig:
    """All that a fault can reach."""

    air: CraftOnAir
    camera: Child
    operator: Operator
    service_pid: int
    flights: Path  # the recorder's folder


@dataclass(frozen=True, slots=True)
class _Kind:
    begin: Callable[[Rig], None]
    end: Callable[[Rig], None] = lambda rig: None


def _camera(**order: Any) -> _Kind:
    """The order holds while the fault lasts; each value's opposite is what was."""
    mended = {name: False if value is True else None for name, value in order.items()}
    return _Kind(lambda rig: rig.camera.order(**order), lambda rig: rig.camera.order(**mended))


def _air(name: str, value: Any, mended: Any) -> _Kind:
    return _Kind(lambda rig: setattr(rig.air, name, value), lambda rig: setattr(rig.air, name, mended))


def _craft(name: str, value: Any, mended: Any) -> _Kind:
    return _Kind(lambda rig: setattr(rig.air.craft, name, value), lambda rig: setattr(rig.air.craft, name, mended))


def _fill_disk(rig: Rig) -> None:
    """What goes beyond the log's size is refused, as on a full disk."""
    _limit_files(rig.service_pid, _recorded_bytes(rig.flights))


def _recorded_bytes(folder: Path) -> int:
    """Of the log that is being written."""
    logs = [flight / "telemetry.tlog" for flight in flights_in(folder)] if folder.is_dir() else []
    return logs[-1].stat().st_size if logs and logs[-1].exists() else 0


def _limit_files(pid: int, size: int | None) -> None:
    """None: as large as they may ever be. Nothing for a process that is gone."""
    with contextlib.suppress(ProcessLookupError):
        _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (hard if size is None else size, hard))


_KINDS = {
    "autopilot silent": _air("is_silent", True, False),
    "junk on the link": _air("mangle", junk(JUNK_SHARE), lambda frame: frame),
    "autopilot reboots": _Kind(lambda rig: rig.air.reboot()),
    "a second autopilot": _Kind(lambda rig: rig.air.add_other(OTHER_SYSTEM), lambda rig: rig.air.remove_other()),
    "position jumps": _craft("jump_enu_m", JUMP_ENU_M, (0.0, 0.0, 0.0)),
    "heading jumps": _craft("heading_jump_rad", HEADING_JUMP_RAD, 0.0),
    "camera frozen": _camera(is_frozen=True),
    "camera black": _camera(is_black=True),
    "camera lost": _camera(is_lost=True),
    "frames of a wrong size": _camera(size=WRONG_SIZE),
    "corrupt JPEGs": _camera(is_corrupt=True),
    "false alarms": _camera(has_false_alarms=True),
    "subscriber away": _Kind(lambda rig: rig.operator.leave(), lambda rig: rig.operator.join()),
    "disk full": _Kind(_fill_disk, lambda rig: _limit_files(rig.service_pid, None)),
}
KINDS = tuple(_KINDS)


@dataclass(slots=True)
class Flown:
    """A fault that came: times in seconds from the start; what the status called it; seconds from its end to well."""

    kind: str
    start_s: float
    end_s: float
    degraded: set[str] = field(default_factory=set)
    recovered_s: float | None = None


class FaultPlayer:
    """Begins and ends the planned faults when their time comes; `play` must be called several times a second."""

    def __init__(self, planned: list[PlannedFault], rig: Rig, start_s: float) -> None:
        self.flown: list[Flown] = []
        self._planned, self._rig, self._start_s = planned, rig, start_s
        self._next = 0
        self._current: Flown | None = None
        self._ended_s: float | None = None

    @property
    def current(self) -> str:
        """The kind that lasts now, or nothing."""
        return "" if self._current is None else self._current.kind

    def play(self) -> None:
        """Whatever is due."""
        t_s = time.monotonic() - self._start_s
        self._look(t_s)
        if self._current is not None and t_s >= self._planned[self._next - 1].end_s:
            self.end()
        if self._next < len(self._planned) and t_s >= self._planned[self._next].start_s:
            fault = self._planned[self._next]
            self._next += 1
            self._current, self._ended_s = Flown(fault.kind, round(t_s, 2), fault.end_s), None
            self.flown.append(self._current)
            _KINDS[fault.kind].begin(self._rig)

    def end(self) -> None:
        """End the fault that lasts, if one does."""
        if self._current is not None:
            _KINDS[self._current.kind].end(self._rig)
            self._ended_s = time.monotonic()
            self._current.end_s = round(self._ended_s - self._start_s, 2)
            self._current = None

    def _look(self, t_s: float) -> None:
        if not self.flown:
            return
        fault, status = self.flown[-1], self._rig.operator.status
        if status is not None and status.at_s - self._start_s > fault.start_s and fault.recovered_s is None:
            fault.degraded.update(status.what["degraded"])
        if self._ended_s is not None and fault.recovered_s is None and self._rig.operator.is_well(self._ended_s):
            fault.recovered_s = round(time.monotonic() - self._ended_s, 2)
