"""Text that came from outside, as a terminal or a log may show it: keys, names of files, a model's metadata, errors."""

import logging

from service.common.redact import redacted

_MOST_CHARACTERS = 500


def shown(text: object, keep: str = "", most: int = _MOST_CHARACTERS) -> str:
    r"""`text` with what a terminal would act on escaped: `\x1b`, `\n`, `\u202e`, but for the characters in `keep`.

    No more than `most` characters of it are looked at; "..." stands for the rest.
    """
    whole = str(text)
    escaped = "".join(one if one.isprintable() or one in keep else _escaped(one) for one in whole[:most])
    return escaped if len(whole) <= most else f"{escaped}..."


def _escaped(character: str) -> str:
    return character.encode("unicode_escape", "backslashreplace").decode("ascii")


class ShownFormatter(logging.Formatter):
    """Each record is one line without secrets that says nothing to the terminal; a traceback keeps its lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """The line."""
        return shown(redacted(super().formatMessage(record)), most=4 * _MOST_CHARACTERS)

    def formatException(self, ei) -> str:  # type: ignore[no-untyped-def]  # logging's own alias is private
        """The traceback."""
        return shown(redacted(super().formatException(ei)), keep="\n", most=40 * _MOST_CHARACTERS)
