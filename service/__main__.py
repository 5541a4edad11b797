"""`python -m service` is `distloc`."""

from service.commands.cli import main
from service.common.process_end import run_process


def distloc() -> None:
    """The console script."""
    run_process(main)


if __name__ == "__main__":
    distloc()
