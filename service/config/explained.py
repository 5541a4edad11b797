"""Says of a validation error which key it is, what it has and what it may be."""

import re
from typing import Any, get_args, get_type_hints

import msgspec

from service.common.redact import redacted

_MOST_CHARACTERS = 300  # msgspec repeats the whole value, however long it is
_PATH = re.compile(r" - at `\$\.?(?P<path>[^`]*)`$")


def explained(error: msgspec.ValidationError, content: dict[str, Any], root: type[msgspec.Struct]) -> str:
    """One line for an error that msgspec raised on `content`; `root` is the struct of the whole file."""
    text = redacted(str(error))
    found = _PATH.search(text)
    path = found["path"] if found else ""
    reason = text[: min(found.start(), _MOST_CHARACTERS)] if found else text[:_MOST_CHARACTERS]
    steps = re.findall(r"[^.\[\]]+", path)
    if "unknown field" in reason:
        allowed = ", ".join(_fields(root, steps))
        return f"{'.'.join(steps) or 'the file'}: {reason[0].lower()}{reason[1:]}; it may have {allowed}"
    value: Any = content
    for step in steps:
        value = value[int(step)] if isinstance(value, list) and step.isdigit() else _get(value, step)
    return f"{path or 'the file'} is {redacted(repr(value)):.60}: {reason[0].lower()}{reason[1:]}"


def _get(value: Any, step: str) -> Any:
    return value.get(step) if isinstance(value, dict) else value


def _fields(root: type[msgspec.Struct], steps: list[str]) -> tuple[str, ...]:
    kind: Any = root
    for step in steps:
        if step != "..." and not step.isdigit():
            kind = get_type_hints(kind).get(step, kind)
        kind = next((one for one in get_args(kind) if hasattr(one, "__struct_fields__")), kind)
    return tuple(getattr(kind, "__struct_fields__", ()))
