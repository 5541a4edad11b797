"""zenoh's TLS, mTLS and passwords with real sessions on the loopback: the crew hears the drone, intruders do not."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
import zenoh

from service.config.sections import ConfigError, ZenohConfig
from service.ground.subscriber import Subscriber
from service.publish.zenoh import ZenohPublisher, zenoh_config
from tests.support.certificates import Authority
from tests.support.places import HANG_S
from tests.support.ports import free_port

REPORT = b'{"report": 1}'


def endpoint(kind: str) -> str:
    return f"{kind}/localhost:{free_port()}"


@contextmanager
def drone(config: ZenohConfig) -> Iterator[ZenohPublisher]:
    """A vehicle's publisher with a report that waits for late joiners."""
    with ZenohPublisher(config, "drone1") as publisher:
        publisher.publish_report(1, REPORT)
        with publisher._changed:
            assert publisher._changed.wait_for(lambda: publisher._published == 1, HANG_S), publisher.state
        yield publisher


def hears(config: ZenohConfig) -> bool:
    """Whether our ground station's Subscriber, so configured, gets the report."""
    heard = threading.Event()
    with Subscriber(config.connect, lambda key, payload: heard.set(), access=config):
        return heard.wait(HANG_S)


def is_refused(config: ZenohConfig) -> bool:
    """Whether the vehicle turns such a client away: zenoh's client mode tells at once."""
    try:
        with zenoh.open(zenoh_config(msgspec.structs.replace(config, mode="client"))) as session:
            return not [*session.info.routers_zid(), *session.info.peers_zid()]
    except zenoh.ZError as error:
        assert "Unable to connect" in str(error), error
        return True


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("ours") / "ca")


@pytest.fixture(scope="module")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("theirs") / "ca")


def secret(path: Path, text: str) -> str:
    path.write_text(text)
    path.chmod(0o600)
    return str(path)


def test_mtls_lets_in_who_has_a_certificate_of_our_authority(ours: Authority, theirs: Authority) -> None:
    at, ca = endpoint("tls"), str(ours.ca)
    certificate, key = ours.issue("drone")
    vehicle = ZenohConfig(listen=(at,), ca_certificate=ca, certificate=certificate, private_key=key)
    with drone(vehicle):
        certificate, key = ours.issue("crew")
        assert hears(ZenohConfig(connect=(at,), ca_certificate=ca, certificate=certificate, private_key=key))
        assert is_refused(ZenohConfig(connect=(at,), ca_certificate=ca))  # knows the authority, has no certificate
        certificate, key = theirs.issue("crew")
        assert is_refused(ZenohConfig(connect=(at,), ca_certificate=ca, certificate=certificate, private_key=key))
        assert is_refused(ZenohConfig(connect=(at.replace("tls/", "tcp/"),)))  # no plain way in


def test_tls_shows_the_crew_a_false_drone(ours: Authority, theirs: Authority) -> None:
    at, ca = endpoint("tls"), str(ours.ca)
    certificate, key = ours.issue("drone")
    with drone(ZenohConfig(listen=(at,), certificate=certificate, private_key=key)):
        assert hears(ZenohConfig(connect=(at,), ca_certificate=ca))
        assert is_refused(ZenohConfig(connect=(at,), ca_certificate=str(theirs.ca)))
    for authority, host in ((theirs, "localhost"), (ours, "elsewhere")):
        at = endpoint("tls")
        certificate, key = authority.issue("false", host)
        with drone(ZenohConfig(listen=(at,), certificate=certificate, private_key=key)):
            assert is_refused(ZenohConfig(connect=(at,), ca_certificate=ca))


def test_a_password_is_asked_for(tmp_path: Path) -> None:
    at = endpoint("tcp")
    users = secret(tmp_path / "users", "crew:fire\n")
    right, wrong = secret(tmp_path / "right", "fire\n"), secret(tmp_path / "wrong", "water\n")
    with drone(ZenohConfig(listen=(at,), users_file=users)):
        assert hears(ZenohConfig(connect=(at,), user="crew", password_file=right))
        assert is_refused(ZenohConfig(connect=(at,)))
        assert is_refused(ZenohConfig(connect=(at,), user="crew", password_file=wrong))
        assert is_refused(ZenohConfig(connect=(at,), user="stranger", password_file=right))


def test_the_drone_may_be_the_one_that_connects(tmp_path: Path) -> None:
    at, heard = endpoint("tcp"), threading.Event()
    crew = ZenohConfig(users_file=secret(tmp_path / "users", "drone1:smoke\n"))
    vehicle = ZenohConfig(connect=(at,), user="drone1", password_file=secret(tmp_path / "password", "smoke\n"))
    false = msgspec.structs.replace(vehicle, password_file=secret(tmp_path / "guess", "mirrors\n"))
    with Subscriber([], lambda key, payload: heard.set(), [at], crew):
        assert is_refused(false)
        with drone(vehicle):
            assert heard.wait(HANG_S)


def test_distloc_ground_takes_its_password_from_a_config(tmp_path: Path) -> None:
    at = endpoint("tcp")
    users = secret(tmp_path / "users", "crew:fire\n")
    (tmp_path / "crew.toml").write_text(
        f'[zenoh]\nuser = "crew"\npassword_file = "{secret(tmp_path / "password", "fire")}"\n'
    )
    command = [sys.executable, "-m", "service", "ground", "--print", "--connect", at]
    command += ["--config", str(tmp_path / "crew.toml")]
    with (
        drone(ZenohConfig(listen=(at,), users_file=users)),
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
    ):
        killer = threading.Timer(HANG_S, process.kill)
        killer.start()
        assert process.stdout is not None
        assert "distloc/drone1/targets/1" in process.stdout.readline()
        killer.cancel()
        process.terminate()
        assert process.wait(HANG_S) == 0


@pytest.mark.parametrize("name", ["password_file", "users_file", "private_key"])
def test_a_secret_that_others_can_read_is_refused(tmp_path: Path, ours: Authority, name: str) -> None:
    certificate, key = ours.issue("careless")
    given = {"password_file": {"user": "crew"}, "users_file": {}, "private_key": {"certificate": certificate}}
    path = tmp_path / "secret"
    path.write_bytes(Path(key).read_bytes())
    path.chmod(0o640)
    with pytest.raises(ConfigError, match=rf"^zenoh\.{name} is .* 0640, must be 0600"):
        zenoh_config(ZenohConfig(**given[name], **{name: str(path)}))
    path.chmod(0o600)
    zenoh_config(ZenohConfig(**given[name], **{name: str(path)}))


def test_a_listener_with_a_password_but_no_users_is_told_so(tmp_path: Path) -> None:
    """zenoh would turn everybody away, the right password too."""
    password = secret(tmp_path / "password", "fire")
    with pytest.raises(ConfigError, match=r"^zenoh\.users_file is empty"):
        zenoh_config(ZenohConfig(listen=("tcp/127.0.0.1:7447",), user="crew", password_file=password))
