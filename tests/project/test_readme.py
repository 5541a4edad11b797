"""What README tells a user to write and run is what the project takes."""

import re

import msgspec
import typer

from distloc.backports import tomllib
from service.commands.cli import app
from service.config.load import check
from service.config.sections import Config
from tests.support.places import ROOT


def test_the_example_config_is_valid() -> None:
    example = re.search(r"```toml\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert example is not None
    config = msgspec.convert(tomllib.loads(example[1]), Config)
    check(config)
    assert config.mavlink.links[0].url == "serial:/dev/ttyTHS1:921600"


def test_ci_runs_the_test_command_of_the_readme() -> None:
    command = "python3 -m venv .venv && .venv/bin/pip install --editable '.[test]' && .venv/bin/python -m pytest"
    assert command in (ROOT / "README.md").read_text()
    assert command in (ROOT / ".ci/run").read_text()


def test_every_file_that_the_readme_names_exists() -> None:
    text = (ROOT / "README.md").read_text()
    paths = re.findall(r"\b(?:distloc|service|docs|systemd)/[a-z_/]+\.[a-z.]+\b", text)
    assert len(paths) >= 10
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_every_command_that_the_readme_has_one_type_is_there() -> None:
    options = {
        name: {text for parameter in command.params for text in parameter.opts}
        for name, command in typer.main.get_command(app).commands.items()  # type: ignore[attr-defined]
    }
    typed = re.findall(
        r"(?:^    |`)(?:\.venv/bin/)?distloc ([a-z]+)([^`\n]*)", (ROOT / "README.md").read_text(), re.MULTILINE
    )
    assert {"autopilot", "check", "run", "ground"} <= {name for name, _ in typed}
    for name, arguments in typed:
        assert name in options
        if name != "study":
            assert set(re.findall(r"--[a-z-]+", arguments)) <= options[name], f"{name}{arguments}"


def test_every_test_and_document_that_a_document_names_exists() -> None:
    there = {path.name for path in (ROOT / "tests").rglob("*.py")} | {path.name for path in ROOT.rglob("*.md")}
    for page in (*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")):
        named = re.findall(r"(?<![\w-])(test_\w+\.py|[\w-]+\.md)\b", page.read_text(encoding="utf-8"))
        assert [name for name in named if name not in there] == [], page
