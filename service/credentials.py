"""Where a secret's file is: systemd puts what `LoadCredential=` names into the folder $CREDENTIALS_DIRECTORY."""

import os
from pathlib import Path

CREDSTORE = Path("/etc/credstore")  # where systemd takes them from, as distloc.NAME


def secret_path(name: str) -> Path:
    """The file of a key or password as a config names it.

    A name without a folder is looked for among the credentials that systemd gave, then, for `distloc check` by root,
    where systemd takes them from; else it is a path like any other.
    """
    if name and Path(name).name == name:
        folder = os.environ.get("CREDENTIALS_DIRECTORY", "")
        given = [Path(folder) / name] if folder else []
        for path in (*given, CREDSTORE / f"distloc.{name}"):
            if os.path.isfile(path):  # False as well where the folder may not be read
                return path
    return Path(name)


def looked_in(name: str) -> str:
    """What to add to "there is no such file": the mend for a secret that should have come from systemd."""
    if Path(name).name != name:
        return ""
    folder = os.environ.get("CREDENTIALS_DIRECTORY", "")
    where = f", nor in {folder}" if folder else ""
    return f"{where}; put it into {CREDSTORE}/distloc.{name} and start the service again"
