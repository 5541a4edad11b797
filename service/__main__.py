"""`python -m service` is `distloc`."""

from service.cli import main

main()
