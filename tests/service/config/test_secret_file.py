"""Secrets named `credential:NAME` come from systemd's credentials."""

import json
import re
from pathlib import Path

import pytest
import zenoh

from service.commands.check.zenoh import check_zenoh
from service.config.secret_file import secret_path
from service.config.sections import ConfigError, ZenohConfig
from service.publish.zenoh import zenoh_config
from tests.support.places import ROOT
from tests.support.ports import free_port


@pytest.fixture
def credentials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "credentials"
    folder.mkdir()
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(folder))
    return folder


def test_where_a_secret_is(credentials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (credentials / "key").write_text("k")
    store = tmp_path / "credstore"
    store.mkdir()
    monkeypatch.setattr("service.config.secret_file.CREDSTORE", store)
    (store / "distloc.key").write_text("k")
    assert secret_path("a.key", "credential:key") == credentials / "key"
    monkeypatch.delenv("CREDENTIALS_DIRECTORY")
    assert secret_path("a.key", "credential:key") == store / "distloc.key"  # `distloc check` by root
    with pytest.raises(ConfigError, match=r"^a\.key is 'key': there is no such file"):
        secret_path("a.key", "key")  # no name of a credential without "credential:"


def test_zenoh_takes_its_key_and_certificate_from_there(credentials: Path) -> None:
    for name in ("zenoh-private-key", "cert.pem"):
        (credentials / name).write_text("PEM")
        (credentials / name).chmod(0o440)  # as systemd's ACL shows
    names = {"certificate": "credential:cert.pem", "private_key": "credential:zenoh-private-key"}
    made = zenoh_config(ZenohConfig(**names))
    for key, name in (("private_key", "zenoh-private-key"), ("certificate", "cert.pem")):
        assert json.loads(made.get_json(f"transport/link/tls/listen_{key}")) == str(credentials / name)


def test_a_certificate_may_be_read_by_all_and_must_be_there(credentials: Path) -> None:
    (credentials / "ca.pem").write_text("PEM")
    (credentials / "ca.pem").chmod(0o644)
    zenoh_config(ZenohConfig(ca_certificate=str(credentials / "ca.pem")))
    for absent, said in ((credentials / "none.pem", "no such file"), (credentials, "not a file")):
        with pytest.raises(ConfigError, match=rf"^zenoh\.ca_certificate is .*{said}"):
            zenoh_config(ZenohConfig(ca_certificate=str(absent)))


def test_a_missing_credential_says_where_to_put_it(credentials: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        zenoh_config(ZenohConfig(user="crew", password_file="credential:zenoh-password"))
    assert str(caught.value) == (
        f"zenoh.password_file is 'credential:zenoh-password': no such credential in {credentials}; "
        "put it into /etc/credstore/distloc.zenoh-password and start the service again"
    )


def test_the_unit_loads_what_the_docs_name() -> None:
    root = ROOT
    loaded = set(
        re.findall(r"^LoadCredential=(\S+):distloc\.\1$", (root / "systemd/distloc.service").read_text(), re.M)
    )
    named = re.compile(r'credential:([a-z0-9.-]+)["`]')
    for text in ("docs/install.md", "docs/security.md"):
        assert set(named.findall((root / text).read_text())) <= loaded, text
    assert set(named.findall((root / "docs/install.md").read_text())) == loaded


@pytest.mark.parametrize(("password", "level"), [("pine", "ok"), ("oak", "fail")])
def test_a_session_with_a_password_from_there(credentials: Path, password: str, level: str) -> None:
    (credentials / "zenoh-password").write_text(f"{password}\n")
    (credentials.parent / "users").write_text("crew:pine\n")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh_config(ZenohConfig(listen=(endpoint,)))
    config.insert_json5("transport/auth/usrpwd/user", '"ground"')
    config.insert_json5("transport/auth/usrpwd/password", '"birch"')
    config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(credentials.parent / "users")))
    with zenoh.open(config):
        (finding,) = check_zenoh(
            ZenohConfig(connect=(endpoint,), user="crew", password_file="credential:zenoh-password"),
            10.0 if level == "ok" else 2.0,
        )
    assert finding.level == level
