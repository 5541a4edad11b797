"""What the doctor says of one part: a line with the mend in it."""

from dataclasses import dataclass
from typing import Literal

from service.common.redact import redacted
from service.common.shown import shown


@dataclass(frozen=True, slots=True)
class Finding:
    """`mend` is what to do about a warning or a failure; only a failure makes `distloc check` fail."""

    level: Literal["ok", "warn", "fail"]
    part: str
    said: str
    mend: str = ""

    def __str__(self) -> str:
        line = f"{self.part}: {self.said}" + (f"; {self.mend}" if self.mend else "")
        return f"{self.level:<4}  {shown(redacted(' '.join(line.split())), most=2000)}"


def ok(part: str, said: str) -> Finding:
    """It works."""
    return Finding("ok", part, said)


def warn(part: str, said: str, mend: str) -> Finding:
    """The service runs with it, but not as well as it could."""
    return Finding("warn", part, said, mend)


def fail(part: str, said: str, mend: str) -> Finding:
    """The service cannot do its work."""
    return Finding("fail", part, said, mend)
