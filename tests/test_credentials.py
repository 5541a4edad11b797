"""Secrets named without a folder come from systemd's credentials."""

import json
import socket
from pathlib import Path

import pytest
import zenoh

from service.check_zenoh import check_zenoh
from service.config import ConfigError, ZenohConfig
from service.credentials import secret_path
from service.publish_zenoh import zenoh_config


@pytest.fixture
def credentials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "credentials"
    folder.mkdir()
    (tmp_path / "outside").write_text("not a credential")
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(folder))
    monkeypatch.chdir(tmp_path)
    return folder


def test_where_a_secret_is(credentials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (credentials / "key").write_text("k")
    assert secret_path("key") == credentials / "key"
    assert secret_path("other") == Path("other")
    assert secret_path("../outside") == Path("../outside")
    assert secret_path("/etc/key") == Path("/etc/key")
    monkeypatch.delenv("CREDENTIALS_DIRECTORY")
    assert secret_path("key") == Path("key")
    monkeypatch.setattr("service.credentials.CREDSTORE", tmp_path / "credstore")
    (tmp_path / "credstore").mkdir()
    (tmp_path / "credstore/distloc.key").write_text("k")
    assert secret_path("key") == tmp_path / "credstore/distloc.key"


def test_zenoh_takes_its_key_from_there(credentials: Path) -> None:
    for name in ("zenoh-private-key", "cert.pem"):
        (credentials / name).write_text("PEM")
    made = zenoh_config(ZenohConfig(certificate="cert.pem", private_key="zenoh-private-key"))
    key = json.loads(made.get_json("transport/link/tls/listen_private_key"))
    assert key == str(credentials / "zenoh-private-key")


def test_a_missing_credential_says_where_to_put_it(credentials: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        zenoh_config(ZenohConfig(user="crew", password_file="zenoh-password"))
    assert str(caught.value) == (
        f"zenoh.password_file is zenoh-password: there is no such file, nor in {credentials}; "
        "put it into /etc/credstore/distloc.zenoh-password and start the service again"
    )


@pytest.mark.parametrize(("password", "level"), [("pine", "ok"), ("oak", "fail")])
def test_a_session_with_a_password_from_there(credentials: Path, password: str, level: str) -> None:
    (credentials / "zenoh-password").write_text(f"{password}\n")
    (credentials.parent / "users").write_text("crew:pine\n")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    config = zenoh_config(ZenohConfig(listen=(endpoint,)))
    config.insert_json5("transport/auth/usrpwd/user", '"ground"')
    config.insert_json5("transport/auth/usrpwd/password", '"birch"')
    config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(credentials.parent / "users")))
    with zenoh.open(config):
        (finding,) = check_zenoh(
            ZenohConfig(connect=(endpoint,), user="crew", password_file="zenoh-password"),
            10.0 if level == "ok" else 2.0,
        )
    assert finding.level == level
