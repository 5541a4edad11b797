"""The environment that the systemd unit gives the service: who measures it from outside starts it as it flies."""

from pathlib import Path

_UNIT = Path(__file__).parents[3] / "systemd" / "distloc.service"


def unit_environment() -> dict[str, str]:
    """The unit's Environment= by name."""
    lines = _UNIT.read_text(encoding="utf-8").splitlines()
    words = [
        word for line in lines if line.startswith("Environment=") for word in line.removeprefix("Environment=").split()
    ]
    return dict(word.split("=", 1) for word in words)
