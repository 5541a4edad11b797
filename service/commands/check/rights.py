"""Whether the service's user may read and write what the config names: root, who runs the doctor, may do anything."""

import os
import pwd
import shutil
import stat
from dataclasses import dataclass
from pathlib import Path

from service.commands.check.finding import Finding, ok, warn
from service.config.endpoint import parse_endpoint
from service.config.sections import Config

SERVICE_USER = "distloc"  # of the unit that `distloc install` writes
HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # by the unit's ProtectHome and PrivateTmp
_READ, _WRITE, _SEARCH = 4, 2, 1  # of a file's mode, for others; _SEARCH of a program: to run it


@dataclass(frozen=True, slots=True)
class User:
    """Who the service runs as."""

    name: str
    uid: int
    gids: frozenset[int]


def service_user(name: str = SERVICE_USER) -> User | None:
    """The user of the unit, if this system has one."""
    try:
        entry = pwd.getpwnam(name)
    except KeyError:
        return None
    return User(name, entry.pw_uid, frozenset(os.getgrouplist(name, entry.pw_gid)))


def check_rights(config: Config, user: User | None = None) -> list[Finding]:
    """What another user than the service's cannot know by trying; nothing where the doctor runs as that user."""
    user = user or service_user()
    if user is None or os.geteuid() == user.uid:
        return []
    refused = [line for key, path, wanted in _named(config) if (line := _refusal(user, key, path, wanted))]
    if not refused:
        return [ok("rights", f"the service's user {user.name} may use what the config names")]
    mend = f"let {user.name}'s group have it (chgrp, chmod), or add {user.name} to the group that has it; not in a home"
    return [warn("rights", line, mend) for line in refused]


def is_allowed(user: User, path: Path, wanted: int) -> bool:
    """Whether a user may (4 read, 2 write, 1 search) a path that exists, and reach it, by the modes alone."""
    resolved = path.resolve()
    return all(_has(user, folder, _SEARCH) for folder in resolved.parents) and _has(user, resolved, wanted)


def _has(user: User, path: Path, wanted: int) -> bool:
    try:
        found = path.stat()
    except OSError:
        return True  # that it is not there is another finding
    if user.uid == 0:
        return True
    shift = 6 if found.st_uid == user.uid else 3 if found.st_gid in user.gids else 0
    return (stat.S_IMODE(found.st_mode) >> shift) & wanted == wanted


def _named(config: Config) -> list[tuple[str, Path, int]]:
    """Key, path and what is wanted of it, of each that is given."""
    source, named = config.camera.source, []
    if source.kind in ("folder", "video", "v4l2") and not source.path.isdecimal():
        wanted = {"folder": _READ | _SEARCH, "video": _READ, "v4l2": _READ | _WRITE}[source.kind]
        named.append(("camera.source.path", Path(source.path), wanted))
    if source.kind == "command" and (program := shutil.which(source.command[0])) is not None:
        named.append(("camera.source.command[0]", Path(program), _SEARCH))
    if config.ground.kind == "dem":
        named.append(("ground.path", Path(config.ground.path), _READ))
    if config.segmenter.kind == "onnx" and config.segmenter.model:
        named.append(("segmenter.model", Path(config.segmenter.model), _READ))
    for folder, key in ((config.recorder.folder, "recorder.folder"), (config.state.dir, "state.dir")):
        if folder:
            named.append((key, Path(folder), _WRITE | _SEARCH))
    for link in config.mavlink.links:
        endpoint = parse_endpoint(link.url)
        if endpoint.kind == "serial":
            named.append(("mavlink.links", Path(endpoint.host), _READ | _WRITE))
    return named


def _refusal(user: User, key: str, path: Path, wanted: int) -> str:
    if any(path.absolute().is_relative_to(hidden) for hidden in HIDDEN):
        return f"{key} is {path}: the unit does not see what is in {', '.join(HIDDEN)}"
    there = next((one for one in (path.absolute(), *path.absolute().parents) if one.exists()), None)
    if there is None or (there != path.absolute() and not wanted & _WRITE):
        return ""
    if is_allowed(user, there, wanted):
        return ""
    what = "write" if wanted & _WRITE else "read" if wanted & _READ else "run"
    return f"{key} is {path}: {user.name}, the service's user, may not {what} it"
