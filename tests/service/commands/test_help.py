"""The help of every command says what was written, square brackets and all."""

from collections.abc import Iterator
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from service.commands.bench.run import PARTS
from service.commands.cli import app


def commands(group: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, command in getattr(group, "commands", {}).items():
        yield (*path, name), command
        yield from commands(command, (*path, name))


ALL = list(commands(typer.main.get_command(app)))


def squeezed(text: str) -> str:
    return "".join(text.split())


@pytest.mark.parametrize(("path", "command"), ALL, ids=[" ".join(path) for path, _ in ALL])
def test_nothing_of_the_help_is_swallowed(path: tuple[str, ...], command: Any) -> None:
    shown = squeezed(CliRunner().invoke(app, [*path, "--help"]).stdout)
    assert squeezed(command.help or "") in shown
    for parameter in command.params:
        if (text := getattr(parameter, "help", None)) is not None:
            assert squeezed(text) in shown


def test_brackets_are_there() -> None:
    assert "its[zenoh]has" in squeezed(CliRunner().invoke(app, ["ground", "--help"]).stdout)
    assert len(ALL) >= 15


def test_bench_names_all_of_its_parts() -> None:
    shown = CliRunner().invoke(app, ["bench", "--help"]).stdout
    assert [part for part in PARTS if part not in shown] == []
