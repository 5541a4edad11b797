"""What every section of the config is made of: the base, the ranges that several use, the error."""

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0.0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0)]
Degrees = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]


class ConfigError(Exception):
    """The configuration is wrong: the message names the key, what it has and what it may be. Exit code 78."""


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the file; a key that it does not know is an error."""
