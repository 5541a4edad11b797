"""Foreign text says nothing to a terminal: not in a line, not in a log, not by the way that commands print."""

import io
import logging

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.commands.check.finding import warn
from service.commands.errors import described
from service.commands.say import say
from service.common.shown import ShownFormatter, shown
from service.config.sections import ConfigError

FOUL = "a\r\x1b[2Kdistloc: all is well\n\x1b]0;t\x07\x9b1m\u202eb\udc80"


@pytest.mark.parametrize(
    ("text", "seen"),
    [
        ("plain, Dröhne 1", "plain, Dröhne 1"),
        ("\x1b[2J", "\\x1b[2J"),
        ("a\nb\tc\r\x9b", "a\\nb\\tc\\r\\x9b"),
        ("\u202e\u2028\udc80", "\\u202e\\u2028\\udc80"),
        ("x" * 600, "x" * 500 + "..."),
    ],
)
def test_what_a_terminal_acts_on_is_escaped(text: str, seen: str) -> None:
    assert shown(text) == seen


@settings(max_examples=50, deadline=None)
@given(st.text())
def test_it_is_one_printable_line(text: str) -> None:
    assert shown(text).isprintable()
    assert shown(shown(text), most=10_000) == shown(text)


def test_logs_and_what_commands_print(capfd: pytest.CaptureFixture[str]) -> None:
    stream = io.StringIO()
    handler = logging.StreamHandler(stream)
    handler.setFormatter(ShownFormatter("%(levelname)s %(name)s: %(message)s"))
    log = logging.Logger("a log")
    log.addHandler(handler)
    log.warning("heard %s", FOUL)
    try:
        raise OSError(FOUL)
    except OSError:
        log.exception("failed")
    lines = stream.getvalue().splitlines()
    assert len(lines) > 3 and all(line.isprintable() for line in lines)
    assert "distloc: all is well" not in lines
    say(FOUL)
    say(described(ConfigError(FOUL)), err=True)
    say(str(warn(FOUL, FOUL, FOUL)))
    out, err = capfd.readouterr()
    assert all(line.isprintable() for line in (out + err).splitlines())
    assert "\x1b" not in out + err
