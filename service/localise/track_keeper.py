"""Keeps the localizer's targets over a restart: takes up those of the last run, once it is known that they still hold,
and hands on those of this run. The localise stage calls it, from its thread; docs/state.md has the rules.
"""

import hashlib
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np

from distloc.geometry.geodesy import LocalFrame
from distloc.localizer import Localizer
from distloc.snapshot import Axes
from distloc.types import CameraPose
from service.autopilot.autopilot import Autopilot
from service.config.sections import Config
from service.localise.continuity import Moment, Refusal, elapsed_s, host_boot_id, refusal
from service.localise.track_store import VERSION, Kept, TrackStore

log = logging.getLogger(__name__)

_PERIOD_S = 1.0
_WAIT_S = 3.0  # for UTC by GPS after a restart of the host: SYSTEM_TIME comes once a second
# what the next pose may answer otherwise: one odd first position or time is no other flight
_ASKED_AGAIN = frozenset({Refusal.NO_CLOCK, Refusal.OTHER_FLIGHT, Refusal.OUT_OF_REACH})


class Keeper(Protocol):
    """What the localise stage asks for."""

    def take_up(self, localizer: Localizer, pose: CameraPose) -> bool:
        """Before each step: False while it isn't known yet whether there are targets to take up."""
        ...

    def keep(self, localizer: Localizer, pose: CameraPose, is_changed: bool) -> None:
        """After each step: have the targets written, if need be."""
        ...

    @property
    def is_resuming(self) -> bool:
        """Whether the last run left targets that are still to be taken up."""
        ...

    def close(self) -> None:
        """The end."""
        ...

    def counters(self) -> dict[str, object]:
        """Figures for the status."""
        ...


class NoKeeper:
    """Keeps nothing."""

    def take_up(self, localizer: Localizer, pose: CameraPose) -> bool:
        """There is nothing to wait for."""
        return True

    def keep(self, localizer: Localizer, pose: CameraPose, is_changed: bool) -> None:
        """Nothing."""

    @property
    def is_resuming(self) -> bool:
        """No."""
        return False

    def close(self) -> None:
        """Nothing."""

    def counters(self) -> dict[str, object]:
        """Nothing but that it is off."""
        return {"kept": "off"}


class TrackKeeper:
    """Reads the file when made; `boot_id` is the host's."""

    def __init__(
        self, config: Config, autopilot: Autopilot, store: TrackStore, max_age_s: float, boot_id: str | None = None
    ) -> None:
        self._vehicle, self._settings = config.vehicle, _fingerprint(config)
        self._autopilot, self._store, self._max_age_s = autopilot, store, max_age_s
        self._boot_id = host_boot_id() if boot_id is None else boot_id
        self._restored = self._unsound = 0
        self._refused: Refusal | None = None
        self._asked_s: float | None = None
        self._kept_s: float | None = None
        self._is_changed = False
        kept = store.read()
        if isinstance(kept, Kept):
            kept = self._of_ours(kept)
        self._candidate = kept if isinstance(kept, Kept) else None
        if isinstance(kept, Refusal):
            self._refused = kept

    @property
    def is_resuming(self) -> bool:
        """Whether the last run left targets that are still to be taken up."""
        return self._candidate is not None

    def take_up(self, localizer: Localizer, pose: CameraPose) -> bool:
        """Give the localizer the last run's targets before its first step; False: not yet, ask with the next pose."""
        kept = self._candidate
        if kept is None:
            return True
        moment, frame_enu = self._moment(pose), self._autopilot.frame_enu
        if moment is None or frame_enu is None:
            return False
        if self._asked_s is None:
            self._asked_s = pose.stamp_s
        R, shift_m = frame_enu.from_other(LocalFrame(*kept.origin))
        was_enu_m = R @ np.array(kept.camera_enu_m) + shift_m
        moved_m = float(np.linalg.norm(pose.position_enu_m - was_enu_m))
        refused = refusal(kept.moment, moment, self._max_age_s, moved_m)
        if refused in _ASKED_AGAIN and 0.0 <= pose.stamp_s - self._asked_s < _WAIT_S:
            return False
        self._candidate, self._refused = None, refused
        if refused is not None:
            log.info("the last run's targets are not taken up: %s", refused)
            return True
        later_s = moment.monotonic_s - (elapsed_s(kept.moment, moment) or 0.0) - kept.moment.monotonic_s
        try:
            localizer.restore(kept.localizer.moved(Axes(R, shift_m, later_s)))
        except ValueError as error:
            self._refused = Refusal.OTHER_SETTINGS
            log.warning("the last run's targets are not taken up: %s", error)
            return True
        self._restored = len(kept.localizer.tracks)
        log.info("the last run's targets are taken up: %d", self._restored)
        return True

    def keep(self, localizer: Localizer, pose: CameraPose, is_changed: bool) -> None:
        """Hand the targets to the store if they changed, at most once a second and never while it still writes."""
        self._is_changed = self._is_changed or is_changed
        if not self._is_changed or not self._store.is_idle:
            return
        if self._kept_s is not None and 0.0 <= pose.stamp_s - self._kept_s < _PERIOD_S:
            return
        moment, frame_enu = self._moment(pose), self._autopilot.frame_enu
        if moment is None or frame_enu is None:
            return
        self._is_changed, self._kept_s = False, pose.stamp_s
        try:
            snapshot = localizer.snapshot()
        except ValueError as error:  # not finite: nothing worth keeping
            self._unsound += 1
            log.debug("the targets cannot be kept: %s", error)
            return
        east_m, north_m, up_m = (float(one) for one in pose.position_enu_m)
        self._store.write(
            Kept(VERSION, self._vehicle, self._settings, moment, frame_enu.origin, (east_m, north_m, up_m), snapshot)
        )

    def close(self) -> None:
        """Let the last write end."""
        self._store.close()

    def counters(self) -> dict[str, object]:
        """Figures for the status."""
        return {
            "kept": "on",
            "written": self._store.written,
            "failed": self._store.failed + self._unsound,
            "restored": self._restored,
            "refused": None if self._refused is None else str(self._refused),
        }

    def _of_ours(self, kept: Kept) -> Kept | Refusal:
        refused = None
        if kept.vehicle != self._vehicle:
            refused = Refusal.OTHER_VEHICLE
        elif kept.settings != self._settings:
            refused = Refusal.OTHER_SETTINGS
        if refused is None:
            return kept
        log.info("%s: its targets are not taken up: %s", self._store.path, refused)
        return refused

    def _moment(self, pose: CameraPose) -> Moment | None:
        """The pose's time on each clock; None before the autopilot's is known."""
        stamp_ns = round(pose.stamp_s * 1e9)
        boot_ns = self._autopilot.boot_from_host(stamp_ns)
        if boot_ns is None:
            return None
        utc_s, source = self._autopilot.utc_s(stamp_ns)
        return Moment(self._boot_id, pose.stamp_s, boot_ns * 1e-9, utc_s if source == "gps" else None)


def state_folder(config: Config, environment: Mapping[str, str] = os.environ) -> Path | None:
    """`state.dir`, or systemd's state directory where the key is left out; None where nothing is kept.

    Nor is anything kept of the bootstrap filter, whose cloud takes the poses as exact.
    """
    folder = config.state.dir
    if folder is None:
        folder = environment.get("STATE_DIRECTORY", "").split(":")[0]  # systemd joins several by colons
    return Path(folder) if folder and config.localizer.filter == "calibrated" else None


def open_keeper(config: Config, autopilot: Autopilot, environment: Mapping[str, str] = os.environ) -> Keeper:
    """A keeper in that folder; else one that does nothing."""
    folder = state_folder(config, environment)
    if folder is None:
        return NoKeeper()
    return TrackKeeper(config, autopilot, TrackStore(folder, config.vehicle), config.state.max_age_s)


def _fingerprint(config: Config) -> str:
    """Of what gives the kept numbers their meaning: the camera but for its source, the localizer but for its seed."""
    camera, localizer = msgspec.structs.asdict(config.camera), msgspec.structs.asdict(config.localizer)
    del camera["source"], localizer["seed"]
    return hashlib.sha256(msgspec.json.encode((camera, localizer), order="deterministic")).hexdigest()[:16]
