"""How commands print: what came from outside says nothing to the terminal."""

import typer

from service.common.shown import shown


def say(text: str, err: bool = False) -> None:
    """A line, or several, on stdout or stderr."""
    typer.echo(shown(text, keep="\n\t", most=len(text)), err=err)
