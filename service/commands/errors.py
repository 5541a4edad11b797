"""Errors as the command line tells them: one line and an exit code."""

from distloc.backports import BaseExceptionGroup
from service.common.shown import shown


class MissingExtraError(Exception):
    """A command needs a package of an extra that is not installed."""


class OutputError(Exception):
    """Results cannot be written where they were asked for."""


def first_of(error: BaseException) -> BaseException:
    """The first error inside the groups that a TaskGroup wraps around it."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    return error


def described(error: BaseException) -> str:
    """One clear line."""
    first = first_of(error)
    text = shown(" ".join(str(first).split()))
    return text if text and type(first).__module__.startswith("service") else f"{type(first).__name__}: {text}"


def exit_code(error: BaseException) -> int:
    """78 for a bad configuration, else 1."""
    from service.config.section import ConfigError

    return 78 if isinstance(first_of(error), ConfigError) else 1
