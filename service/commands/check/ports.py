"""Two links on one port: the second never opens, or steals the first one's bytes. The doctor and nobody else asks."""

from collections import defaultdict

from service.commands.check.finding import Finding, warn
from service.config.endpoint import Endpoint, parse_endpoint
from service.config.sections import Config

_ANY = ("0.0.0.0", "::", "")


def check_ports(config: Config) -> list[Finding]:
    """A warning for each pair of links, or link and zenoh endpoint, that want one port of this computer."""
    taken: dict[tuple[str, int], list[tuple[str, str]]] = defaultdict(list)
    findings = []
    for host, transport, port, name in _wanted(config):
        for other_host, other in taken[transport, port]:
            if port and (host == other_host or host in _ANY or other_host in _ANY):
                mend = "give each a port of its own"
                findings.append(warn("ports", f"{other} and {name} are on one port", mend))
        taken[transport, port].append((host, name))
    return findings


def _wanted(config: Config) -> list[tuple[str, str, int, str]]:
    """Host, transport, port and name of each place that is listened on, or opened for oneself alone."""
    wanted = []
    for link in config.mavlink.links:
        endpoint = parse_endpoint(link.url)
        if endpoint.kind == "serial":
            wanted.append((endpoint.host, f"serial {endpoint.host}", 1, link.url))
        else:
            wanted.append((_host(endpoint), endpoint.kind, endpoint.port, link.url))
    for place in config.zenoh.listen if config.zenoh.enabled else ():
        transport, _, address = place.partition("/")
        host, _, port = address.partition("?")[0].partition("#")[0].rpartition(":")
        if transport in ("tcp", "tls", "ws") and port.isdigit():
            wanted.append((host.strip("[]"), "tcpin", int(port), place))
        elif transport in ("udp", "quic") and port.isdigit():
            wanted.append((host.strip("[]"), "udpin", int(port), place))
    return wanted


def _host(endpoint: Endpoint) -> str:
    return "127.0.0.1" if endpoint.host == "localhost" else endpoint.host
