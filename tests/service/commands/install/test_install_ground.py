"""`distloc install --ground`: the second unit, as hardened as the first, and its config; removed as it was written."""

import shutil
import subprocess
from pathlib import Path

import pytest

from service.commands.install.install import SOURCES, InstallError, install, uninstall
from service.config.load import load_config

EXEC = "/opt/distloc/bin/distloc"
UNIT, CONFIG = "etc/systemd/system/distloc-ground.service", "etc/distloc/ground.toml"
DRONE_UNIT, DRONE_CONFIG, USERS = (
    *("etc/systemd/system/distloc.service", "etc/distloc/config.toml"),
    "etc/sysusers.d/distloc.conf",
)


def installed(root: Path) -> list[str]:
    said: list[str] = []
    install(root, EXEC, True, said.append, is_ground=True)
    return said


def test_it_is_written_without_the_drones_service_and_removed_again(tmp_path: Path) -> None:
    said = installed(tmp_path)
    assert f"write   /{UNIT}" in said and not (tmp_path / "etc/systemd/system/distloc.service").exists()
    assert f"ExecStart={EXEC} ground --config /{CONFIG} " in (tmp_path / UNIT).read_text()
    assert load_config(tmp_path / CONFIG).zenoh.listen == ("tcp/0.0.0.0:7447",)
    wants = tmp_path / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir()
    (wants / "distloc-ground.service").symlink_to(f"/{UNIT}")
    with pytest.raises(InstallError, match=r"disable .* distloc-ground"):
        uninstall(tmp_path, False, True, said.append, is_ground=True)
    (wants / "distloc-ground.service").unlink()
    uninstall(tmp_path, False, True, said.append, is_ground=True)
    assert not (tmp_path / UNIT).exists() and (tmp_path / CONFIG).exists()
    (tmp_path / "var/lib/distloc-ground").mkdir(parents=True)
    uninstall(tmp_path, True, True, said.append, is_ground=True)
    assert not (tmp_path / CONFIG).exists() and not (tmp_path / "var/lib/distloc-ground").exists()


@pytest.mark.parametrize("is_ground", [False, True])
def test_of_both_on_one_computer_each_goes_alone_and_what_they_share_with_the_last(
    tmp_path: Path, is_ground: bool
) -> None:
    said = installed(tmp_path)
    install(tmp_path, EXEC, True, said.append, ("pi",))
    drone = {DRONE_UNIT, f"{DRONE_UNIT}.d/pi.conf", DRONE_CONFIG}
    ground = {UNIT, CONFIG}
    for state in ("distloc", "distloc-ground"):
        (tmp_path / "var/lib" / state).mkdir(parents=True)
    (tmp_path / "etc/distloc/ca.pem").write_text("theirs")
    wants = tmp_path / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir()
    other_unit = DRONE_UNIT if is_ground else UNIT
    (wants / Path(other_unit).name).symlink_to(f"/{other_unit}")  # it runs, and is left alone
    said.clear()
    uninstall(tmp_path, True, True, said.append, is_ground=is_ground)
    gone, kept = (ground, drone) if is_ground else (drone, ground)
    command = "distloc uninstall" if is_ground else "distloc uninstall --ground"
    assert f"keep    /{other_unit}  ({command} removes it)" in said
    assert f"keep    /{USERS}  ({Path(other_unit).name} needs it)" in said
    assert all((tmp_path / path).exists() for path in (*kept, USERS, "etc/distloc/ca.pem"))
    assert not any((tmp_path / path).exists() for path in gone)
    assert [path.name for path in (tmp_path / "var/lib").iterdir()] == ["distloc" if is_ground else "distloc-ground"]
    (wants / Path(other_unit).name).unlink()
    uninstall(tmp_path, True, True, said.append, is_ground=not is_ground)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_another_boards_drop_in_goes_and_one_that_is_not_named_is_told(tmp_path: Path) -> None:
    said: list[str] = []
    install(tmp_path, EXEC, True, said.append, ("jetson",))
    install(tmp_path, EXEC, True, said.append, ("pi",))
    jetson, pi = (f"{DRONE_UNIT}.d/{name}.conf" for name in ("jetson", "pi"))
    assert f"remove  /{jetson}" in said and not (tmp_path / jetson).exists() and (tmp_path / pi).exists()
    install(tmp_path, EXEC, True, said.append)
    assert said[-1] == f"keep    /{pi}  (of install --pi, which was given before)"
    (tmp_path / pi).write_text("[Service]\n")
    install(tmp_path, EXEC, True, said.append, ("jetson",))
    assert said[-1] == f"keep    /{pi}  (it was changed)" and (tmp_path / jetson).exists()


def test_it_is_as_hardened_as_the_drones_unit_but_for_devices() -> None:
    def settings(name: str) -> set[str]:
        lines = (SOURCES / name).read_text().splitlines()
        return {line for line in lines if "=" in line and not line.startswith("#")}

    free = ("ExecStart", "Description", "State", "Working", "Memory", "Tasks", "CPU", "Device", "Watchdog", "Load")
    missing = settings("distloc.service") - settings("distloc-ground.service")
    assert {line for line in missing if not line.startswith((*free, "RestartPrevent"))} == set()
    assert "PrivateDevices=yes" in settings("distloc-ground.service")


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_has_nothing_to_say_of_it(tmp_path: Path) -> None:
    unit = tmp_path / "distloc-ground.service"
    unit.write_text((SOURCES / "distloc-ground.service").read_text().replace(EXEC, "/bin/true"))
    done = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    score = ["systemd-analyze", "security", "--offline=true", "--threshold=20", str(unit)]
    assert subprocess.run(score, capture_output=True, check=False).returncode == 0
