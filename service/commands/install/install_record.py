"""What `distloc install` wrote, so that `uninstall` removes nothing else: a file that `sha256sum -c` can read."""

import re
from pathlib import Path

from service.common.files import write_whole

RECORD = Path("etc/distloc/installed.sha256")  # root's own, as the service's user must not say what root removes
_LINE = re.compile(r"^([0-9a-f]{64})  /(\S+)$")


def read_record(root: Path) -> dict[Path, str]:
    """SHA-256 by path below the root; lines that are none are passed over."""
    try:
        text = (root / RECORD).read_text(encoding="utf-8", errors="replace")
    except (FileNotFoundError, PermissionError):
        return {}
    found = (_LINE.match(line) for line in text.splitlines())
    return {Path(match[2]): match[1] for match in found if match}


def write_record(root: Path, record: dict[Path, str]) -> None:
    """Replace the record; an empty one is removed, and its folder if nothing else is in it."""
    path = root / RECORD
    if record and path.parent.is_dir():
        write_whole(path, "".join(f"{value}  /{name}\n" for name, value in sorted(record.items())).encode())
    elif not record:
        path.unlink(missing_ok=True)
        if path.parent.is_dir() and not any(path.parent.iterdir()):
            path.parent.rmdir()
