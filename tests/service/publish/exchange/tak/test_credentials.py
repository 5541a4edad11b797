"""Certificates as TAK servers give them: what is taken, and what is refused in one line that names the key."""

import ssl
from pathlib import Path

import pytest

from service.config.sections import ConfigError
from service.config.tak_section import TakConfig
from service.publish.exchange.tak.credentials import tls_context
from tests.support.certificates import Authority, openssl


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("tak") / "ca")


def closed_file(path: Path, content: bytes) -> str:
    path.write_bytes(content)
    path.chmod(0o600)
    return str(path)


def pkcs12(authority: Authority, path: Path, password: str, *options: str) -> str:
    certificate, key = authority.issue(path.stem)
    made = ("-inkey", key, "-in", certificate, "-certfile", authority.ca, "-passout", f"pass:{password}")
    openssl("pkcs12", "-export", "-out", path, *made, *options)
    path.chmod(0o600)
    return str(path)


def shakes_hands(client: ssl.SSLContext, authority: Authority) -> str:
    """In memory, with a server that wants our certificate: the name that ours has."""
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(*authority.issue("server"))
    server.verify_mode = ssl.CERT_REQUIRED
    server.load_verify_locations(authority.ca)
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ours = client.wrap_bio(to_client, to_server, server_hostname="localhost")
    theirs = server.wrap_bio(to_server, to_client, server_side=True)
    for _ in range(4):
        for one in (ours, theirs):
            try:
                one.do_handshake()
            except ssl.SSLWantReadError:
                continue
    (name,) = (value for part in theirs.getpeercert()["subject"] for key, value in part if key == "commonName")  # type: ignore[index, union-attr, misc]
    return str(name)


def test_pem_with_and_without_a_password(authority: Authority, tmp_path: Path) -> None:
    certificate, key = authority.issue("drone1")
    locked = tmp_path / "locked.key"
    openssl("pkey", "-in", key, "-aes256", "-passout", "pass:secret", "-out", locked)
    locked.chmod(0o600)
    both = closed_file(tmp_path / "both.pem", Path(certificate).read_bytes() + Path(key).read_bytes())
    password = closed_file(tmp_path / "password", b"secret\n")
    for config in (
        TakConfig(ca_certificate=str(authority.ca), certificate=certificate, private_key=key),
        TakConfig(
            ca_certificate=str(authority.ca),
            certificate=certificate,
            private_key=str(locked),
            password_file=password,
        ),
        TakConfig(ca_certificate=str(authority.ca), certificate=both),
    ):
        assert shakes_hands(tls_context(config), authority) == "drone1"


def test_pkcs12_brings_key_certificate_and_authority(authority: Authority, tmp_path: Path) -> None:
    password = closed_file(tmp_path / "password", b"atakatak")
    made = pkcs12(authority, tmp_path / "drone2.p12", "atakatak")
    before = {path.name for path in tmp_path.iterdir()}
    context = tls_context(TakConfig(certificate=made, password_file=password))
    assert shakes_hands(context, authority) == "drone2"
    assert {path.name for path in tmp_path.iterdir()} == before  # the key came to no disk


def test_what_cannot_be_used_is_one_line_that_names_the_key(authority: Authority, tmp_path: Path) -> None:
    certificate, key = authority.issue("drone3")
    _, other_key = authority.issue("drone4")
    junk, wrong = closed_file(tmp_path / "junk.pem", b"junk"), closed_file(tmp_path / "wrong", b"wrong")
    junk12 = closed_file(tmp_path / "junk.p12", b"junk")
    made = pkcs12(authority, tmp_path / "drone5.p12", "atakatak")
    open_key = tmp_path / "open.key"
    open_key.write_bytes(Path(key).read_bytes())
    open_key.chmod(0o644)
    bare = tmp_path / "bare.p12"
    openssl("pkcs12", "-export", "-nokeys", "-in", certificate, "-passout", "pass:", "-out", bare)
    bare.chmod(0o600)
    for config, said in (
        (TakConfig(ca_certificate=junk), "tak.ca_certificate is .*no certificate in PEM"),
        (TakConfig(ca_certificate=str(tmp_path / "none")), "tak.ca_certificate is .*no such file"),
        (TakConfig(certificate=certificate, private_key=other_key), "tak.private_key is .*belong together"),
        (TakConfig(certificate=certificate, private_key=str(open_key)), "tak.private_key is .*mode is 0644"),
        (TakConfig(certificate=junk), "tak.certificate is .*PEM"),
        (TakConfig(certificate=junk12), "tak.certificate is .*no PKCS#12"),
        (TakConfig(certificate=made, password_file=wrong), "tak.certificate is .*password"),
        (TakConfig(certificate=made), "tak.certificate is .*password"),
        (TakConfig(certificate=str(bare)), "tak.certificate is .*(lacks the key|no PKCS#12)"),
    ):
        with pytest.raises(ConfigError, match=said) as found:
            tls_context(config)
        assert "\n" not in str(found.value)
