"""The one URL syntax of MAVLink endpoints: udpin:, udpout:, tcp:, tcpin: HOST:PORT and serial:/dev/ttyX:BAUD."""

from dataclasses import dataclass
from typing import Literal, cast

from service.common.redact import redacted

Kind = Literal["udpin", "udpout", "tcp", "tcpin", "serial"]

_MOST_CHARACTERS = 300


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where a link goes: `host` is a serial port's path and `port` its baud rate for the kind serial."""

    kind: Kind
    host: str
    port: int

    @property
    def url(self) -> str:
        """As it was written."""
        return f"{self.kind}:{self.host}:{self.port}"


def parse_endpoint(url: str) -> Endpoint:
    """The endpoint of a URL; ValueError in one line for anything else."""
    if len(url) > _MOST_CHARACTERS:
        raise ValueError(f"{redacted(url)[:40]!r} and so on: must be no longer than {_MOST_CHARACTERS} characters")
    kind, _, rest = url.partition(":")
    host, _, number = rest.rpartition(":")
    if kind not in ("udpin", "udpout", "tcp", "tcpin", "serial"):
        raise ValueError(f"{redacted(url)!r}: must start with udpin:, udpout:, tcp:, tcpin: or serial:")
    if not host or not (number.isascii() and number.isdigit()):
        form = "serial:/dev/ttyX:BAUD" if kind == "serial" else f"{kind}:HOST:PORT"
        raise ValueError(f"{redacted(url)!r}: must have the form {form}")
    try:
        host.strip("[]").encode("idna")
    except UnicodeError as error:
        if kind != "serial":
            raise ValueError(f"{redacted(url)!r:.80}: {host!r:.40} is no host's name or address") from error
    lowest = 0 if kind in ("udpin", "tcpin") else 1
    if not lowest <= int(number) <= (10_000_000 if kind == "serial" else 65_535):
        raise ValueError(f"{redacted(url)!r}: {number} is no {'baud rate' if kind == 'serial' else 'port'}")
    return Endpoint(cast(Kind, kind), host.strip("[]"), int(number))
