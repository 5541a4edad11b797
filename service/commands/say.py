"""How commands print: without secrets, and what came from outside says nothing to the terminal."""

import typer

from service.common.redact import redacted
from service.common.shown import shown


def say(text: str, err: bool = False) -> None:
    """A line, or several, on stdout or stderr."""
    typer.echo(shown(redacted(text), keep="\n\t", most=2 * len(text)), err=err)
