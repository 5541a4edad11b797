"""Where keys and passwords lie: a systemd credential, or a file that only its owner may read; links and zenoh ask."""

import os
import re
from pathlib import Path

from service.config.sections import ConfigError

CREDSTORE = Path("/etc/credstore")  # where systemd takes credentials from, ours as distloc.NAME
_CREDENTIAL = "credential:"
_OTHERS = 0o077  # group and others
_MOST_BYTES = 65_536


def secret_path(key: str, value: str) -> Path:
    """The file that the config's `key` names: `credential:NAME` or a path.

    A credential is in $CREDENTIALS_DIRECTORY or, for `distloc check` by root, where systemd takes it from. Raises
    ConfigError where there is none, or where group or others may read a path's file. A credential's mode is systemd's
    matter: it gives the service access by an ACL, which shows as the group's bits.
    """
    path = public_path(key, value)
    mode = path.stat().st_mode & 0o777
    if mode & _OTHERS and not value.startswith(_CREDENTIAL):
        raise ConfigError(f"{key} is {value!r}: its mode is {mode:04o}, must be 0600: chmod 600 it")
    return path


def public_path(key: str, value: str) -> Path:
    """As `secret_path`, for what all may read, such as certificates."""
    if value.startswith(_CREDENTIAL):
        return _credential(key, value)
    path = Path(value)
    try:
        path.stat()
    except OSError as error:
        raise ConfigError(f"{key} is {value!r}: there is no such file that can be read") from error
    if not path.is_file():
        raise ConfigError(f"{key} is {value!r}: not a file")
    return path


def read_secret(key: str, value: str) -> bytes:
    """What that file holds; ConfigError as above, or where it cannot be read."""
    try:
        with secret_path(key, value).open("rb") as file:
            return file.read(_MOST_BYTES)
    except OSError as error:
        raise ConfigError(f"{key} is {value!r}: cannot be read: {error.strerror}") from error


def _credential(key: str, value: str) -> Path:
    name, folder = value.removeprefix(_CREDENTIAL), os.environ.get("CREDENTIALS_DIRECTORY", "")
    if not re.fullmatch(r"[A-Za-z0-9_.-]+", name) or name in (".", ".."):
        raise ConfigError(f"{key} is {value!r}: a credential's name has letters, digits, '.', '_' and '-'")
    stored = CREDSTORE / f"distloc.{name}"
    for path in (*([Path(folder) / name] if folder else []), stored):
        if os.path.isfile(path):  # False as well where the folder may not be read
            return path
    where = f"in {folder}" if folder else "given by systemd ($CREDENTIALS_DIRECTORY is not set)"
    raise ConfigError(
        f"{key} is {value!r}: no such credential {where}; put it into {stored} and start the service again"
    )
