"""The TCP and UDP sockets that a process has open, read from /proc by inode."""

import ipaddress
import os
import re
import struct
from dataclasses import dataclass
from pathlib import Path

_LISTEN = "0A"
_ANY_PEER = ":0000"


@dataclass(frozen=True, slots=True)
class OpenSocket:
    """One that can be sent to from outside: a listening TCP socket, or a UDP or raw one that no peer is fixed to."""

    kind: str  # tcp, udp, raw, each with 6 for IPv6
    host: str
    port: int


def open_sockets(pid: int) -> set[OpenSocket]:
    """What listens in the process, in its network namespace."""
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        try:
            found = re.fullmatch(r"socket:\[(\d+)\]", os.readlink(entry))
        except FileNotFoundError:
            continue  # closed meanwhile
        if found:
            inodes.add(found[1])
    listening = set()
    for kind in ("tcp", "udp", "raw", "tcp6", "udp6", "raw6"):
        table = Path(f"/proc/{pid}/net/{kind}")
        for line in table.read_text().splitlines()[1:] if table.exists() else []:
            _, local, peer, state, *rest = line.split()
            is_open = state == _LISTEN if kind.startswith("tcp") else peer.endswith(_ANY_PEER)
            if rest[5] in inodes and is_open:
                listening.add(OpenSocket(kind, _host(local), int(local.rpartition(":")[2], 16)))
    return listening


def _host(local: str) -> str:
    words = re.findall("........", local.rpartition(":")[0])
    return str(ipaddress.ip_address(b"".join(struct.pack("=I", int(word, 16)) for word in words)))
