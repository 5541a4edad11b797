"""Looks at the computer on a thread of its own: a sensor or a disk that hangs holds up nothing else."""

import logging
import threading
from pathlib import Path

from service.common.host import SLICES, HostReader, HostState
from service.config.sections import Config
from service.localise.track_keeper import state_folder

_SLICE_S = 0.1
_log = logging.getLogger(__name__)


class HostWatch:
    """`state` is at most about a second old. A board that slows down for heat or voltage is logged as it begins."""

    def __init__(self, reader: HostReader) -> None:
        self.state: HostState | None = None
        self._reader, self._ended = reader, threading.Event()
        self._told: tuple[str, ...] = ()
        self._thread = threading.Thread(target=self._watch, name="host", daemon=True)

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def close(self) -> None:
        """Look no more; a look that hangs is not waited for."""
        self._ended.set()

    def look(self) -> None:
        """Once, and tell what has begun."""
        self.state = state = self._reader.state()
        faults = faults_of(state)
        for fault in faults:
            if fault not in self._told:
                _log.warning("%s", fault)
        self._told = faults

    def _watch(self) -> None:
        number = 0
        while not self._ended.wait(_SLICE_S):
            self._reader.slice()
            if number % SLICES == 0:
                self.look()
            number += 1


def make_host_watch(config: Config) -> HostWatch:
    """Of the disk that the service writes to: the recorder's, or that of its state."""
    folder = Path(config.recorder.folder) if config.recorder.folder else state_folder(config) or Path("/")
    there = next(one for one in (folder.absolute(), *folder.absolute().parents) if one.exists())
    return HostWatch(HostReader(there))


def faults_of(state: HostState) -> tuple[str, ...]:
    """What slows the board down now, each with its mend."""
    faults = []
    if state.is_under_voltage:
        faults.append("the board's voltage is too low: give it a stronger supply or a shorter cable")
    if state.is_too_hot:
        faults.append("the board is too hot and slows down: give it air, or fewer frames (camera.source.fps)")
    elif state.is_cpu_throttled:
        faults.append("the board holds its clock down: look at its supply and its cooling")
    return tuple(faults)
