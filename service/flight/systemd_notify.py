"""Tells systemd how the service is: one datagram a call to $NOTIFY_SOCKET, nothing where that is unset."""

import logging
import os
import socket

_log = logging.getLogger(__name__)


def notify(*assignments: str) -> bool:
    """Send e.g. `notify("READY=1", "STATUS=flying")`; True if it was handed over.

    Never raises on a missing or full socket and never waits: the service must not hang on its supervisor.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address or address[0] not in "/@":
        return False
    if address[0] == "@":
        address = "\0" + address[1:]
    payload = "\n".join(line.replace("\n", " ") for line in assignments).encode()
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sock:
            sock.setblocking(False)
            sock.sendto(payload, address)
    except OSError as error:
        _log.debug("systemd was not notified: %s", error)
        return False
    return True
