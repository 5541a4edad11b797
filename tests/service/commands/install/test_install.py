"""`distloc install` and `uninstall` below a root of the test's own: what is said is what is done, and undone."""

import fnmatch
import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from distloc.backports import tomllib
from service.commands.install.install import SOURCES, InstallError, check_rights, install, uninstall
from service.config.load import load_config
from service.config.sections import Config
from tests.support.places import HANG_S

EXEC = "/opt/distloc/bin/distloc"
UNIT, USERS = "etc/systemd/system/distloc.service", "etc/sysusers.d/distloc.conf"
CONFIG, RECORD = "etc/distloc/config.toml", "etc/distloc/installed.sha256"
DROP_IN = "etc/systemd/system/distloc.service.d/jetson.conf"


def files(root: Path) -> dict[str, bytes]:
    return {str(path.relative_to(root)): path.read_bytes() for path in sorted(root.rglob("*")) if path.is_file()}


def installed(root: Path, executable: str = EXEC, *, jetson: bool = False, acts: bool = True) -> list[str]:
    said: list[str] = []
    install(root, executable, acts, said.append, ("jetson",) if jetson else ())
    return said


def uninstalled(root: Path, *, purges: bool = False, acts: bool = True) -> list[str]:
    said: list[str] = []
    uninstall(root, purges, acts, said.append)
    return said


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "service", *arguments]
    return subprocess.run(line, capture_output=True, text=True, timeout=HANG_S, check=False)


def test_the_dry_run_says_what_yes_does_and_does_nothing(tmp_path: Path) -> None:
    dry = command("install", "--root", str(tmp_path), "--exec", EXEC, "--jetson")
    assert (dry.returncode, dry.stderr, files(tmp_path)) == (0, "", {})
    wet = command("install", "--root", str(tmp_path), "--exec", EXEC, "--jetson", "--yes")
    assert wet.returncode == 0
    assert dry.stdout == wet.stdout + "nothing was done: --yes does it\n"
    written = {line.split()[1] for line in wet.stdout.splitlines() if line.startswith("write")}
    assert written == {f"/{path}" for path in (UNIT, USERS, CONFIG, DROP_IN)}
    assert set(files(tmp_path)) == {UNIT, USERS, CONFIG, DROP_IN, RECORD}


def test_what_is_installed(tmp_path: Path) -> None:
    installed(tmp_path, "/srv/venv-1.2/bin/distloc")
    assert (
        "ExecStart=/srv/venv-1.2/bin/distloc run --config /etc/distloc/config.toml\n" in (tmp_path / UNIT).read_text()
    )
    assert load_config(tmp_path / CONFIG) == Config()
    for path in (UNIT, USERS, CONFIG):
        assert (tmp_path / path).stat().st_mode & 0o777 == 0o644
    recorded = dict(line.split("  /")[::-1] for line in (tmp_path / RECORD).read_text().splitlines())
    written = {path: hashlib.sha256(data).hexdigest() for path, data in files(tmp_path).items() if path != RECORD}
    assert recorded == written
    assert not list(tmp_path.rglob("*.part"))


def test_by_default_the_unit_runs_the_interpreters_own_distloc(tmp_path: Path) -> None:
    done = command("install", "--root", str(tmp_path), "--yes")
    assert done.returncode == 0
    own = Path(sys.executable).with_name("distloc")
    assert f"ExecStart={own} run " in (tmp_path / UNIT).read_text()
    assert f"warn    {own} is not in {tmp_path}" in done.stdout


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_takes_what_is_installed(tmp_path: Path) -> None:
    executable = re.sub(r"[^/]+$", "env", shutil.which("env") or "/usr/bin/env")
    installed(tmp_path, executable, jetson=True)
    verify = ["systemd-analyze", "verify", str(tmp_path / UNIT)]
    done = subprocess.run(verify, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="systemd-sysusers is not installed")
@pytest.mark.skipif(os.geteuid() != 0, reason="systemd-sysusers needs root")
def test_the_user_is_made_with_its_groups(tmp_path: Path) -> None:
    installed(tmp_path)
    make = ["systemd-sysusers", f"--root={tmp_path}", str(tmp_path / USERS)]
    subprocess.run(make, capture_output=True, timeout=HANG_S, check=True)
    groups = dict(line.split(":")[::3] for line in (tmp_path / "etc/group").read_text().splitlines())
    assert (groups["dialout"], groups["video"]) == ("distloc", "distloc")
    assert re.search(r"^distloc:x:\d+:\d+:.*:/var/lib/distloc:\S*nologin$", (tmp_path / "etc/passwd").read_text(), re.M)


def test_every_key_of_the_commented_config_is_the_default(tmp_path: Path) -> None:
    text = re.sub(r"(?m)^#(?=[\[a-z])", "", (SOURCES / "config.toml").read_text())
    (tmp_path / "c.toml").write_text(text)
    shown, default = tomllib.loads(text), msgspec.to_builtins(Config())
    assert load_config(tmp_path / "c.toml").mavlink.links[0].faces == "autopilot"
    del shown["mavlink"]["links"]
    assert len(shown) == 11

    def differing(left: dict[str, object], right: dict[str, object]) -> list[str]:
        found = []
        for key, value in left.items():
            if isinstance(value, dict):
                found += differing(value, right[key])  # type: ignore[arg-type]
            elif list(right[key]) != value if isinstance(value, list) else right[key] != value:  # type: ignore[call-overload]
                found.append(key)
        return found

    assert differing(shown, default) == []


def test_twice_is_once_and_another_executable_updates_the_unit(tmp_path: Path) -> None:
    installed(tmp_path)
    before = files(tmp_path)
    assert [line.split()[0] for line in installed(tmp_path) if "/etc" in line] == ["keep"] * 3
    assert files(tmp_path) == before
    said = installed(tmp_path, "/srv/distloc")
    assert [line for line in said if line.startswith("update")] == [
        f"update  /{UNIT}  (unchanged since it was installed)"
    ]
    assert "ExecStart=/srv/distloc run" in (tmp_path / UNIT).read_text()


def test_what_was_changed_is_never_overwritten_nor_removed(tmp_path: Path) -> None:
    installed(tmp_path)
    (tmp_path / CONFIG).write_text('vehicle = "mine"\n')
    (tmp_path / UNIT).write_text("[Service]\nExecStart=/mine\n")
    said = installed(tmp_path, "/srv/distloc")
    assert any(line.startswith(f"keep    /{UNIT}  (it was changed; move the change to a drop-in") for line in said)
    assert f"keep    /{UNIT}  (it was changed)" in uninstalled(tmp_path)
    assert (tmp_path / CONFIG).read_text() == 'vehicle = "mine"\n'
    assert (tmp_path / UNIT).read_text() == "[Service]\nExecStart=/mine\n"
    assert not (tmp_path / USERS).exists()


def test_uninstall_leaves_what_install_did_not_write(tmp_path: Path) -> None:
    for path in (UNIT, "etc/systemd/system/other.service", "var/lib/distloc/flight/frames.csv"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("theirs\n")
    before = files(tmp_path)
    assert f"keep    /{UNIT}  (distloc install did not write it)" in uninstalled(tmp_path)
    assert files(tmp_path) == before


def test_uninstall_keeps_config_and_state_unless_purged(tmp_path: Path) -> None:
    (tmp_path / "etc/hostname").parent.mkdir()
    (tmp_path / "etc/hostname").write_text("drone\n")
    installed(tmp_path, jetson=True)
    state = tmp_path / "var/lib/distloc/flight.csv"
    state.parent.mkdir(parents=True)
    state.write_text("kept")
    full = files(tmp_path)
    uninstalled(tmp_path, acts=False)
    assert files(tmp_path) == full
    uninstalled(tmp_path)
    kept = {"etc/hostname", CONFIG, RECORD, "var/lib/distloc/flight.csv"}
    assert set(files(tmp_path)) == kept
    assert not (tmp_path / DROP_IN).parent.exists()
    assert "nothing is left to do" in uninstalled(tmp_path, acts=False)
    uninstalled(tmp_path)
    assert set(files(tmp_path)) == kept
    installed(tmp_path, jetson=True)
    assert files(tmp_path) == full
    for _ in range(2):
        uninstalled(tmp_path, purges=True)
        assert set(files(tmp_path)) == {"etc/hostname"}


def test_a_record_cannot_name_other_files_for_removal(tmp_path: Path) -> None:
    installed(tmp_path)
    other = tmp_path / "etc/shadow"
    other.write_text("secret")
    with (tmp_path / RECORD).open("a") as record:
        record.write(f"{hashlib.sha256(b'secret').hexdigest()}  /etc/shadow\nnonsense\n")
    uninstalled(tmp_path, purges=True)
    assert other.read_text() == "secret"


def test_an_enabled_service_is_not_removed(tmp_path: Path) -> None:
    installed(tmp_path)
    wants = tmp_path / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir()
    (wants / "distloc.service").symlink_to("/etc/systemd/system/distloc.service")
    before = files(tmp_path)
    with pytest.raises(InstallError, match=r"first run systemctl disable --root=\S+ distloc$"):
        uninstalled(tmp_path)
    assert files(tmp_path) == before


def test_a_link_of_the_image_does_not_lead_into_the_live_system(tmp_path: Path) -> None:
    root, live = tmp_path / "image", tmp_path / "live"
    (root / "etc").mkdir(parents=True)
    live.mkdir()
    (root / "etc/systemd").symlink_to(live)
    with pytest.raises(InstallError, match=r"leads out of .* through a link"):
        installed(root)
    assert files(live) == files(root) == {}


def test_a_config_that_is_a_link_to_nothing_yet_is_kept(tmp_path: Path) -> None:
    link = tmp_path / CONFIG
    link.parent.mkdir(parents=True)
    link.symlink_to("../../data/mine.toml")
    assert f"keep    /{CONFIG}  (a link to ../../data/mine.toml, which is not there)" in installed(tmp_path)
    assert link.is_symlink() and not link.exists() and (tmp_path / UNIT).exists()


def test_a_link_in_the_place_of_a_half_written_file_is_not_followed(tmp_path: Path) -> None:
    root, victim = tmp_path / "image", tmp_path / "victim"
    victim.write_text("precious")
    for path in (CONFIG, UNIT, RECORD):
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / f"{path}.part").symlink_to(victim)
    installed(root)
    assert victim.read_text() == "precious"
    assert load_config(root / CONFIG) == Config() and not (root / CONFIG).is_symlink()
    assert not list(root.rglob("*.part"))


def test_a_record_outside_of_the_root_is_not_touched(tmp_path: Path) -> None:
    root, host = tmp_path / "image", tmp_path / "host"
    installed(root)
    shutil.move(root / "etc/distloc", host)
    (root / "etc/distloc").symlink_to(host)
    before = files(tmp_path)
    with pytest.raises(InstallError, match=r"installed\.sha256 leads out of .* through a link"):
        uninstalled(root)
    assert files(tmp_path) == before


@pytest.mark.parametrize("is_there", [True, False])
def test_a_state_folder_that_is_a_link_is_told_before_anything_is_removed(tmp_path: Path, is_there: bool) -> None:
    installed(tmp_path)
    (tmp_path / "var/lib").mkdir(parents=True)
    (tmp_path / "var/lib/distloc").symlink_to("../../data")
    if is_there:
        (tmp_path / "data").mkdir()
    before = files(tmp_path)
    with pytest.raises(InstallError, match=r"var/lib/distloc is a link to \.\./\.\./data: remove"):
        uninstalled(tmp_path, purges=True)
    assert files(tmp_path) == before


def test_without_root_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert check_rights(Path("/"), acts=False) == Path("/")
    with pytest.raises(InstallError, match=r"needs root: run it with sudo, or give --root DIR"):
        check_rights(Path("/"), acts=True)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("--root", "nowhere"), 1, "there is no such folder"),
        (("--root", ".", "--exec", "bin/distloc"), 2, "absolute path"),
        (("--root", ".", "--exec", "/a b"), 2, "absolute path"),
        (("--root", ".", "--exec", "/%h/distloc"), 2, "absolute path"),
        (("--root", "blocked", "--yes"), 1, "Not a directory"),
    ],
)
def test_bad_input_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], code: int, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "blocked").mkdir()
    (tmp_path / "blocked/etc").write_text("a file")
    done = command("install", *arguments)
    assert done.returncode == code
    assert said in " ".join(done.stderr.replace("│", " ").split())
    assert "Traceback" not in done.stderr
    assert set(files(tmp_path)) == {"blocked/etc"}


def test_the_wheel_carries_every_file() -> None:
    project = tomllib.loads((SOURCES.parent / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert "systemd" in project["packages"]["find"]["include"]
    patterns = project["package-data"]["systemd"]
    shipped = [str(path.relative_to(SOURCES)) for path in SOURCES.rglob("*") if path.is_file()]
    assert len(shipped) >= 4
    assert [name for name in shipped if not any(fnmatch.fnmatch(name, pattern) for pattern in patterns)] == []
