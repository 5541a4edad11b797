"""`distloc check`: tries each part that a config names and says what is wrong and how to mend it."""

import asyncio
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from service.commands.check.camera import check_camera
from service.commands.check.dem import check_dem
from service.commands.check.finding import Finding, fail, ok, warn
from service.commands.check.links import check_links
from service.commands.check.ports import check_ports
from service.commands.check.rights import check_rights
from service.commands.check.segmenter import check_segmenter
from service.commands.check.tak import check_tak
from service.commands.check.view import check_view
from service.commands.check.zenoh import check_zenoh
from service.config.sections import Config
from service.localise.track_keeper import state_folder

STATE = Path("/var/lib/distloc")
_LEAST_FREE_GB, _ENOUGH_FREE_GB = 0.2, 2.0  # an hour of 5 full-HD JPEG a second is about 5 GB

Say = Callable[[str], None]


async def run_check(config: Config, say: Say, listen_s: float) -> bool:
    """Say a line for each finding, those of the live parts after `listen_s`; True if nothing failed."""
    findings = []
    for finding in _at_rest(config):
        say(str(finding))
        findings.append(finding)
    camera = asyncio.to_thread(check_camera, config.camera, listen_s)
    zenoh = asyncio.to_thread(check_zenoh, config.zenoh, listen_s)
    tak = asyncio.to_thread(check_tak, config.tak)
    for live in await asyncio.gather(check_links(config, listen_s), camera, zenoh, tak):
        for finding in live:
            say(str(finding))
        findings += live
    return all(finding.level != "fail" for finding in findings)


def _at_rest(config: Config) -> Iterator[Finding]:
    """What needs no listening; each is said as soon as it is found, as an engine for a GPU takes minutes."""
    yield ok("config", "read")
    yield from check_view(config)
    yield from check_segmenter(config)
    yield from _check_ground(config)
    yield from _check_disk(config)
    yield _check_state(config)
    yield from check_rights(config)
    yield from check_ports(config)


def _check_ground(config: Config) -> list[Finding]:
    if config.ground.kind == "off":
        return []
    findings = []
    if config.localizer.filter == "bootstrap":
        said = "localizer.filter is 'bootstrap', which takes no prior from the ground"
        findings.append(warn("ground", said, "take localizer.filter = 'calibrated' or ground.kind = 'off'"))
    if config.ground.kind == "flat":
        return [*findings, ok("ground", f"flat at home's altitude, +-{config.ground.height_sigma_m:g} m")]
    return [*findings, *check_dem(config.ground)]


def _check_disk(config: Config) -> list[Finding]:
    """Room where the flight is recorded; without a recorder, where the service keeps its state."""
    wanted = Path(config.recorder.folder) if config.recorder.folder else STATE
    folder = next(one for one in (wanted.absolute(), *wanted.absolute().parents) if one.is_dir())
    try:
        free_gb = shutil.disk_usage(folder).free * 1e-9
    except OSError as error:
        return [fail("disk", f"{folder}: {error.strerror}", "mend the disk or give recorder.folder another")]
    said = f"{free_gb:.1f} GB free in {folder}"
    if config.recorder.folder and free_gb < max(_LEAST_FREE_GB, config.recorder.least_free_gb):
        return [fail("disk", said, "delete old recordings or give recorder.folder another disk")]
    if free_gb < (_ENOUGH_FREE_GB if config.recorder.folder else _LEAST_FREE_GB):
        return [warn("disk", said, "delete what is old: a flight with its frames takes some GB an hour")]
    return [ok("disk", said)]


def _check_state(config: Config) -> Finding:
    """Whether targets are kept over a restart (docs/state.md)."""
    folder = state_folder(config)
    if folder is None:
        if config.state.dir is None and config.localizer.filter == "calibrated":
            return ok("state", f"off without systemd, whose service keeps the targets in {STATE}")
        return ok("state", "off: after a crash the service starts with no targets")
    there = next(one for one in (folder.absolute(), *folder.absolute().parents) if one.exists())
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        return warn("state", f"{there} cannot be written", "give it to the service's user, or state.dir another folder")
    return ok("state", f"targets are kept in {folder}")
