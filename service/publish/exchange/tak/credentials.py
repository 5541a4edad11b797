"""The TLS context of [tak]: certificates as PEM files or as PKCS#12, which TAK servers give to their clients."""

import os
import ssl
from pathlib import Path

from service.config.secret_file import public_path, read_secret, secret_path
from service.config.sections import ConfigError
from service.config.tak_section import TakConfig

_PKCS12 = (".p12", ".pfx")
_MOST_BYTES = 1_000_000


def tls_context(config: TakConfig) -> ssl.SSLContext:
    """Checks the server's certificate and name, always. ConfigError in one line for what cannot be used."""
    context = ssl.create_default_context()
    if config.ca_certificate:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)  # and no other authority
        path = public_path("tak.ca_certificate", config.ca_certificate)
        try:
            context.load_verify_locations(cafile=path)
        except (OSError, ValueError) as error:  # an SSLError is an OSError
            raise ConfigError(f"tak.ca_certificate is {config.ca_certificate!r}: no certificate in PEM") from error
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if config.certificate:
        password = read_secret("tak.password_file", config.password_file).strip() if config.password_file else b""
        if config.certificate.lower().endswith(_PKCS12):
            _load_pkcs12(context, config, password)
        else:
            _load_pem(context, config, password)
    return context


def _load_pem(context: ssl.SSLContext, config: TakConfig, password: bytes) -> None:
    key = "tak.private_key" if config.private_key else "tak.certificate"
    secret = secret_path(key, config.private_key or config.certificate)
    certificate = public_path("tak.certificate", config.certificate)
    try:
        context.load_cert_chain(certificate, secret, lambda: password)  # never asks the terminal for it
    except (OSError, ValueError) as error:
        why = "the password is wrong or lacks, or it is no key and certificate in PEM that belong together"
        raise ConfigError(f"{key} is {(config.private_key or config.certificate)!r}: {why}") from error


def _load_pkcs12(context: ssl.SSLContext, config: TakConfig, password: bytes) -> None:
    try:
        from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, pkcs12
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"tak.certificate is {config.certificate!r}: PKCS#12 needs pip install 'distloc[tak]'; or give PEM files"
        ) from error
    content = _content(secret_path("tak.certificate", config.certificate), config.certificate)
    try:
        key, certificate, others = pkcs12.load_key_and_certificates(content, password or None)
    except ValueError as error:
        why = "no PKCS#12, or the password of tak.password_file is not its own"
        raise ConfigError(f"tak.certificate is {config.certificate!r}: {why}") from error
    if key is None or certificate is None:
        raise ConfigError(f"tak.certificate is {config.certificate!r}: it lacks the key or the certificate")
    chain = [one.public_bytes(Encoding.PEM) for one in (certificate, *others)]
    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    if others and not config.ca_certificate:
        context.load_verify_locations(cadata=b"".join(chain[1:]).decode())
    file = os.memfd_create("tak")  # ssl takes keys from files only; this one is on no disk
    try:
        with os.fdopen(os.dup(file), "wb") as memory:
            memory.write(secret + b"".join(chain))
        context.load_cert_chain(f"/proc/self/fd/{file}")
    except OSError as error:
        raise ConfigError(f"tak.certificate is {config.certificate!r}: its key and certificate do not fit") from error
    finally:
        os.close(file)


def _content(path: Path, named: str) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_MOST_BYTES)
    except OSError as error:
        raise ConfigError(f"tak.certificate is {named!r}: cannot be read: {error.strerror}") from error
