"""What the service's user may not do, judged without being that user; links that share a port."""

import os
from pathlib import Path

import pytest

from service.commands.check import rights
from service.commands.check.ports import check_ports
from service.commands.check.rights import User, check_rights, is_allowed, service_user
from service.config.sections import (
    CameraConfig,
    Config,
    GroundConfig,
    LinkConfig,
    MavlinkConfig,
    RecorderConfig,
    SegmenterConfig,
    SourceConfig,
    StateConfig,
    ZenohConfig,
)

STRANGER = User("distloc", 4_000_001, frozenset({4_000_001}))


@pytest.fixture
def seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that anybody may reach, as if the unit saw it."""
    monkeypatch.setattr(rights, "HIDDEN", ())
    for folder in (tmp_path, *tmp_path.parents):
        if folder.stat().st_uid == os.geteuid() and folder != Path("/"):
            folder.chmod(folder.stat().st_mode | 0o711)
    return tmp_path


@pytest.mark.parametrize(
    ("mode", "wanted", "others", "group", "owner"),
    [
        (0o644, 4, True, True, True),
        (0o640, 4, False, True, True),
        (0o600, 4, False, False, True),
        (0o644, 2, False, False, True),
        (0o660, 6, False, True, True),
        (0o066, 4, True, True, False),
    ],
)
def test_a_mode_is_read_as_the_system_does(
    seen: Path, mode: int, wanted: int, others: bool, group: bool, owner: bool
) -> None:
    path = seen / "file"
    path.touch()
    path.chmod(mode)
    found = path.stat()
    assert is_allowed(STRANGER, path, wanted) == others
    assert is_allowed(User("x", 4_000_001, frozenset({found.st_gid})), path, wanted) == group
    if found.st_uid:  # root may do anything
        assert is_allowed(User("x", found.st_uid, frozenset()), path, wanted) == owner


def test_a_folder_that_is_shut_hides_what_is_in_it(seen: Path) -> None:
    (seen / "shut").mkdir()
    (seen / "shut" / "file").touch()
    (seen / "shut" / "file").chmod(0o666)
    (seen / "shut").chmod(0o700)
    assert not is_allowed(STRANGER, seen / "shut" / "file", 4)


def test_each_part_of_the_config_is_judged(seen: Path) -> None:
    for name in ("film", "dem", "model", "port"):
        (seen / name).touch()
        (seen / name).chmod(0o600)
    (seen / "records").mkdir(mode=0o755)
    config = Config(
        camera=CameraConfig(source=SourceConfig(kind="video", path=str(seen / "film"))),
        ground=GroundConfig(kind="dem", path=str(seen / "dem")),
        segmenter=SegmenterConfig(kind="onnx", model=str(seen / "model")),
        recorder=RecorderConfig(folder=str(seen / "records" / "new")),
        state=StateConfig(dir=str(seen / "records")),
        mavlink=MavlinkConfig(links=(LinkConfig(url=f"serial:{seen}/port:57600"),)),
    )
    found = check_rights(config, STRANGER)
    keys = ["camera.source.path", "ground.path", "segmenter.model", "recorder.folder", "state.dir", "mavlink.links"]
    assert [one.said.split(" is ")[0] for one in found] == keys
    assert {one.level for one in found} == {"warn"} and "the service's user, may not read it" in found[0].said
    for name in ("film", "dem", "model", "port"):
        (seen / name).chmod(0o666)
    (seen / "records").chmod(0o777)
    assert [one.level for one in check_rights(config, STRANGER)] == ["ok"]


def test_a_home_is_not_seen_by_the_unit() -> None:
    config = Config(recorder=RecorderConfig(folder="/home/pilot/flights"))
    (finding,) = check_rights(config, STRANGER)
    assert "recorder.folder is /home/pilot/flights: the unit does not see what is in /home" in finding.said


def test_without_such_a_user_or_as_that_user_nothing_is_said() -> None:
    assert service_user("no-such-user-here") is None
    config = Config(recorder=RecorderConfig(folder="/home/pilot/flights"))
    assert check_rights(config, User("me", os.geteuid(), frozenset())) == []


@pytest.mark.parametrize(
    ("urls", "listen", "pairs"),
    [
        (("udpin:0.0.0.0:14550", "udpin:127.0.0.1:14550"), (), 1),
        (("serial:/dev/ttyS0:57600", "serial:/dev/ttyS0:921600"), (), 1),
        (("udpout:192.0.2.1:14550",) * 3, (), 3),
        (("tcpin:0.0.0.0:7447",), ("tcp/0.0.0.0:7447",), 1),
        (("tcpin:localhost:7447",), ("tls/127.0.0.1:7447?x=1",), 1),
        (("udpin:127.0.0.1:14550", "udpin:127.0.0.1:14551"), (), 0),
        (("udpin:127.0.0.1:14550", "udpout:127.0.0.1:14550", "tcpin:127.0.0.1:14550"), (), 0),
        (("udpin:127.0.0.1:0", "udpin:127.0.0.1:0"), (), 0),
        (("udpin:127.0.0.1:1", "udpin:127.0.0.2:1"), ("udp/127.0.0.3:1",), 0),
    ],
)
def test_two_on_one_port(urls: tuple[str, ...], listen: tuple[str, ...], pairs: int) -> None:
    links = tuple(LinkConfig(url=url) for url in urls)
    found = check_ports(Config(mavlink=MavlinkConfig(links=links), zenoh=ZenohConfig(listen=listen)))
    assert len(found) == pairs and all("are on one port" in one.said for one in found)
