"""`distloc install` and `uninstall`: which files, and what becomes of each; a plan first, done only when told to."""

import hashlib
import os
import shutil
import sysconfig
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from pathlib import Path

from service.commands.install.board_limits import Board, limited
from service.commands.install.install_record import RECORD, read_record, write_record
from service.common.files import write_whole

Say = Callable[[str], None]

SOURCES = Path(__file__).parents[3] / "systemd"  # beside this package in a checkout and once installed
UNIT = Path("etc/systemd/system/distloc.service")
DROP_INS = {name: Path(f"etc/systemd/system/distloc.service.d/{name}.conf") for name in ("jetson", "pi")}
USERS = Path("etc/sysusers.d/distloc.conf")
CONFIG = Path("etc/distloc/config.toml")
WANTS = Path("etc/systemd/system/multi-user.target.wants")
GROUND_UNIT = Path("etc/systemd/system/distloc-ground.service")
GROUND_CONFIG = Path("etc/distloc/ground.toml")
STATE = Path("var/lib/distloc")
GROUND_STATE = Path("var/lib/distloc-ground")
SHIPPED_EXEC = "/opt/distloc/bin/distloc"
_HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # from the unit: ProtectHome=, PrivateTmp=
_ALLOWED = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789/._+@-")


class InstallError(Exception):
    """It cannot be installed or removed; nothing was changed."""


@dataclass(frozen=True, slots=True)
class Step:
    """One thing to do to a file below the root; without `act` it is only told."""

    verb: str
    path: Path
    reason: str = ""
    act: Callable[[], None] | None = None

    def __str__(self) -> str:
        return f"{self.verb:<7} {self.path}" + (f"  ({self.reason})" if self.reason else "")


def install(
    root: Path,
    executable: str | None,
    acts: bool,
    say: Say,
    profiles: Sequence[str] = (),
    board: Board | None = None,
    is_ground: bool = False,
) -> None:
    """Plan what `root` lacks, say it, and with `acts` do it; ValueError for an `executable` that a unit cannot name.

    `profiles` are names in DROP_INS; the limits are for the `board`, or as shipped where it is not known.
    `is_ground`: the ground station's service in place of the drone's.
    """
    command = executable or str(Path(sysconfig.get_path("scripts")) / "distloc")
    _check_command(command)
    record = _record(root)
    unit, config = (GROUND_UNIT, GROUND_CONFIG) if is_ground else (UNIT, CONFIG)
    wanted = {unit: _unit(unit.name, command), USERS: _source("distloc.sysusers"), config: _source(config.name)}
    wanted |= {DROP_INS[name]: _source(f"distloc.service.d/{name}.conf") for name in profiles}
    if board is not None and not is_ground:
        wanted |= {path: limited(data, board, has_gpu=path in DROP_INS.values()) for path, data in wanted.items()}
        say(f"limits for {board.cores} cores and {board.memory_mb} MB of memory")
    steps = [_write(root, path, data, record) for path, data in wanted.items()]
    if not is_ground:
        steps += _earlier_boards(root, wanted, record, is_another=bool(profiles))
    for line in _warnings(root, command):
        say(line)
    _carry_out(root, steps, record, acts, say)
    if acts and root == Path("/"):
        say(f"now run:\n  systemd-sysusers\n  systemctl daemon-reload\n  systemctl enable --now {unit.stem}")
        say("then open http://127.0.0.1:8080/" if is_ground else f"then try: {command} check --config /{CONFIG}")


def uninstall(root: Path, purges: bool, acts: bool, say: Say, is_ground: bool = False) -> None:
    """Remove what `install` wrote and nobody changed since; with `purges` also the config and the state.

    Of the drone's service, or where it `is_ground` of the ground station's; what both need goes with the last.
    """
    drone, ground = (UNIT, CONFIG, STATE), (GROUND_UNIT, GROUND_CONFIG, GROUND_STATE)
    (unit, config, state), (other, other_config, _) = (ground, drone) if is_ground else (drone, ground)
    if (root / WANTS / unit.name).is_symlink():
        option = "--now" if root == Path("/") else f"--root={root}"
        raise InstallError(f"the service is enabled: first run systemctl disable {option} {unit.stem}")
    record = _record(root)
    steps = [_remove(root, path, record) for path in (unit, *(() if is_ground else DROP_INS.values()))]
    if _has(root, other):
        command = "distloc uninstall" if is_ground else "distloc uninstall --ground"
        steps.append(Step("keep", Path("/") / other, f"{command} removes it"))
        steps.append(Step("keep", Path("/") / USERS, f"{other.name} needs it"))
    else:
        steps.append(_remove(root, USERS, record))
    if purges:
        is_shared = _has(root, other) or _has(root, other_config)
        steps += [_purge(root, config if is_shared else config.parent), _purge(root, state)]
    else:
        steps += [Step("keep", Path("/") / path, "--purge removes it") for path in (config, state) if _has(root, path)]
    _carry_out(root, steps, record, acts, say)
    if acts and root == Path("/"):
        say("now run: systemctl daemon-reload")


def check_rights(root: Path, acts: bool) -> Path:
    """The root made absolute; InstallError where it cannot be written to as it should."""
    if root != Path("/"):
        if not root.is_dir():
            raise InstallError(f"--root is {root}: there is no such folder")
        return root.resolve()
    if acts and os.geteuid() != 0:
        raise InstallError("writing to /etc needs root: run it with sudo, or give --root DIR")
    return root


def _record(root: Path) -> dict[Path, str]:
    _check_inside(root, Path("/") / RECORD)
    return read_record(root)


def _carry_out(root: Path, steps: list[Step], record: dict[Path, str], acts: bool, say: Say) -> None:
    for step in steps:
        _check_inside(root, step.path)
    try:
        for step in steps:
            say(str(step))
            if acts and step.act:
                step.act()
    except OSError as error:
        raise InstallError(
            f"{error.filename or step.path}: {error.strerror or error}; run it again once that is mended"
        ) from error
    finally:
        if acts and any(step.act for step in steps):
            write_record(root, record)
    if not acts:
        say("nothing was done: --yes does it" if any(step.act for step in steps) else "nothing is left to do")


def _write(root: Path, path: Path, data: bytes, record: dict[Path, str]) -> Step:
    shown, target = Path("/") / path, root / path
    had = _hash_of(target)

    def act() -> None:
        target.parent.mkdir(parents=True, exist_ok=True, mode=0o755)
        write_whole(target, data)
        target.chmod(0o644)
        record[path] = _hash(data)

    if had is None and target.is_symlink():
        return Step("keep", shown, f"a link to {target.readlink()}, which is not there")
    if had is None:
        return Step("write", shown, act=act)
    if had == _hash(data):
        return Step("keep", shown, "as it should be")
    if had == record.get(path):
        return Step("update", shown, "unchanged since it was installed", act)
    is_config = path in (CONFIG, GROUND_CONFIG)
    mend = "" if is_config else "; move the change to a drop-in and delete the file to have the new one"
    return Step("keep", shown, f"it was changed{mend}")


def _remove(root: Path, path: Path, record: dict[Path, str]) -> Step:
    shown, target = Path("/") / path, root / path
    had = _hash_of(target)

    def act() -> None:
        target.unlink()
        record.pop(path, None)
        if path in DROP_INS.values() and not any(target.parent.iterdir()):
            target.parent.rmdir()

    if had is None:
        return Step("absent", shown)
    if path not in record:
        return Step("keep", shown, "distloc install did not write it")
    return Step("remove", shown, act=act) if had == record[path] else Step("keep", shown, "it was changed")


def _earlier_boards(root: Path, wanted: Container[Path], record: dict[Path, str], is_another: bool) -> list[Step]:
    """Drop-ins that are not `wanted` now: they go where this `is_another` board, and are told where none is."""
    found = [path for path in DROP_INS.values() if path not in wanted and _has(root, path)]
    if is_another:
        return [_remove(root, path, record) for path in found]
    return [Step("keep", Path("/") / path, f"of install --{path.stem}, which was given before") for path in found]


def _purge(root: Path, path: Path) -> Step:
    shown, target = Path("/") / path, root / path
    if target.is_symlink():
        raise InstallError(f"{target} is a link to {target.readlink()}: remove the link and what it leads to by hand")
    if not _has(root, path):
        return Step("absent", shown)
    if target.is_file():
        return Step("remove", shown, act=target.unlink)
    return Step("remove", shown, "with all in it", lambda: shutil.rmtree(target))


def _has(root: Path, path: Path) -> bool:
    return (root / path).exists()


def _source(name: str) -> bytes:
    return (SOURCES / name).read_bytes()


def _unit(name: str, command: str) -> bytes:
    return _source(name).replace(SHIPPED_EXEC.encode(), command.encode())


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _hash_of(path: Path) -> str | None:
    try:
        return _hash(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise InstallError(f"{path}: cannot be read: {error.strerror}") from error


def _check_command(command: str) -> None:
    if not command.startswith("/") or not set(command) <= _ALLOWED:
        raise ValueError(f"--exec is {command!r}: it must be an absolute path of letters, digits and / . _ + @ -")


def _check_inside(root: Path, path: Path) -> None:
    """An image's own links may be absolute: followed from outside they lead into the live system."""
    target = root / path.relative_to("/")
    if root != Path("/") and not target.resolve().is_relative_to(root):
        raise InstallError(f"{target} leads out of {root} through a link")


def _warnings(root: Path, command: str) -> list[str]:
    lines = []
    if not (root / command.lstrip("/")).exists():
        lines.append(
            f"warn    {command} is not in {root}: install distloc into a virtual environment there, or give --exec"
        )
    base = os.path.realpath(Path(command).with_name("python"))
    if any(one.startswith(f"{folder}/") for folder in _HIDDEN for one in (command, base)):
        lines.append(f"warn    the service cannot see {command} under ProtectHome= and PrivateTmp=: use /opt/distloc")
    return lines
