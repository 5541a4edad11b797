"""Files that appear under their final name only once they are complete."""

import os
from pathlib import Path


def write_whole(path: Path, data: bytes) -> None:
    """Write beside the final name, then rename."""
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    os.replace(part, path)
