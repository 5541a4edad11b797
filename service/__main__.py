"""`python -m service` is `distloc`."""

from service.cli import main
from service.process_end import run_process


def distloc() -> None:
    """The console script."""
    run_process(main)


if __name__ == "__main__":
    distloc()
