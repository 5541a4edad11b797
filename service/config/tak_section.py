"""The config's section [tak]: where Cursor on Target events go, and by which certificates. Free of I/O."""

import re
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Annotated, Literal, cast

import msgspec

from service.common.shown import shown
from service.config.section import ConfigError, Section

Scheme = Literal["udp", "tcp", "tls"]
_FORM = "must have the form udp://HOST:PORT, tcp://HOST:PORT or tls://HOST:PORT"


class TakConfig(Section, frozen=True):
    urls: Annotated[tuple[str, ...], msgspec.Meta(max_length=4)] = ()  # e.g. "udp://239.2.3.1:6969"; empty: off
    ca_certificate: str = ""  # PEM of the authority that signed the server's; empty: the system's, or the .p12's
    certificate: str = ""  # ours: PEM, or PKCS#12 (.p12) with the key in it
    private_key: str = ""  # PEM; where the certificate's file holds it: empty
    password_file: str = ""  # of the private key or the .p12
    server_name: str = ""  # that the server's certificate must have; empty: the host of the URL
    interface: str = ""  # address of the own interface that multicast leaves by; empty: the system's choice
    tentative: bool = False  # fires that are not sure yet as well, as smoke
    drone: bool = True  # the drone's own place as well


@dataclass(frozen=True, slots=True)
class TakUrl:
    """Where events go."""

    scheme: Scheme
    host: str
    port: int

    @property
    def text(self) -> str:
        """As it was written."""
        return f"{self.scheme}://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def tak_url(key: str, text: str) -> TakUrl:
    """ConfigError in one line for anything else."""
    match = re.fullmatch(r"(udp|tcp|tls)://(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]{1,253}):(\d{1,5})", text)
    if match is None or not 1 <= int(match[3]) <= 65_535:
        raise ConfigError(f"{key} is {shown(text, most=80)!r}: {_FORM}")
    return TakUrl(cast(Scheme, match[1]), match[2].strip("[]"), int(match[3]))


def check_tak(config: TakConfig) -> None:
    """Raise ConfigError where keys contradict each other."""
    schemes = {tak_url(f"tak.urls[{number}]", one).scheme for number, one in enumerate(config.urls)}
    if config.private_key and not config.certificate:
        raise ConfigError("tak.private_key is given without tak.certificate: give both, or a .p12 as the certificate")
    if config.password_file and not config.certificate:
        raise ConfigError("tak.password_file is given without tak.certificate: what is it the password of?")
    if config.urls and "tls" not in schemes and (config.certificate or config.ca_certificate):
        raise ConfigError("tak.certificate or tak.ca_certificate is given and no URL of tak.urls begins with tls://")
    if config.interface:
        try:
            ip_address(config.interface)
        except ValueError as error:
            raise ConfigError(f"tak.interface is {config.interface[:80]!r}: must be an interface's address") from error
