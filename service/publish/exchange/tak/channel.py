"""How events leave: datagrams, or a TCP or TLS connection to a TAK server. Blocking, with a time limit on each step."""

import contextlib
import select
import socket
import ssl
import time
from typing import Protocol

from distloc.backports import StrEnum
from service.config.tak_section import TakUrl

CONNECT_S, SEND_S = 10.0, 10.0
_SEND_BUFFER = 65_536  # what waits in the system for a server that is slow grows old there
_UNACKNOWLEDGED_MS = 15_000
_READ_BYTES, _MOST_READS = 65_536, 16
_FIRST_BYTES = (b"<", b"\xbf")  # XML, or the TAK protocol's magic number


class TakFault(StrEnum):
    """Why there is no link; the status counts each."""

    NO_HOST = "no such host"
    UNREACHABLE = "host or network not reachable"
    REFUSED = "connection refused"
    NO_ANSWER = "no answer within 10 s"
    NO_HANDSHAKE = "no TLS handshake within 10 s"
    WRONG_CERTIFICATE = "the server's certificate is not trusted"
    NOT_TLS = "what answers speaks no TLS that we do"
    OUR_CERTIFICATE = "the server refuses our certificate"
    CLOSED = "closed by the server"
    NONSENSE = "what answers is no TAK server"
    NOT_READING = "the server takes nothing for 10 s"
    OTHER = "another fault"


class TakLinkError(Exception):
    """The link cannot be used; `fault` is why, the message one line."""

    def __init__(self, fault: TakFault, detail: str = "") -> None:
        super().__init__(f"{fault}: {detail}" if detail else str(fault))
        self.fault = fault


class Channel(Protocol):
    """An open link; both raise TakLinkError."""

    def send(self, event: bytes) -> None:
        """All of it."""

    def poll(self) -> None:
        """Throw away what came, which nobody here reads; see whether the other end is still there."""

    def close(self) -> None:
        """Never raises."""


class Datagrams:
    """To a multicast group or one host. TakLinkError on construction."""

    def __init__(self, url: TakUrl, interface: str = "") -> None:
        family, kind, _, _, self._address = _found(url, socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind)
        try:
            if interface and family == socket.AF_INET:
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
            self._socket.settimeout(SEND_S)
        except OSError as error:
            self.close()
            raise TakLinkError(TakFault.UNREACHABLE, error.strerror or "") from error

    def send(self, event: bytes) -> None:
        try:
            self._socket.sendto(event, self._address)
        except OSError as error:
            raise TakLinkError(TakFault.UNREACHABLE, error.strerror or "") from error

    def poll(self) -> None:
        """Nothing is bound: nothing comes."""

    def close(self) -> None:
        self._socket.close()


class Stream:
    """A TCP connection, inside TLS where there is a context. TakLinkError on construction."""

    def __init__(self, url: TakUrl, context: ssl.SSLContext | None = None, server_name: str = "") -> None:
        self._has_spoken = False
        self._socket: socket.socket = _connected(url)
        try:
            if context is not None:
                self._socket = _shaken(self._socket, context, server_name or url.host)
        except (OSError, ValueError) as error:
            self.close()
            raise _tls_error(error) from error

    def send(self, event: bytes) -> None:
        try:
            self._socket.settimeout(SEND_S)
            self._socket.sendall(event)
        except TimeoutError as error:
            raise TakLinkError(TakFault.NOT_READING) from error
        except OSError as error:
            raise _lost(error) from error

    def poll(self) -> None:
        """Reads no more than a megabyte at once: a server that floods has to wait."""
        self._socket.settimeout(0.0)
        for _ in range(_MOST_READS):
            try:
                data = self._socket.recv(_READ_BYTES)
            except (BlockingIOError, ssl.SSLWantReadError, ssl.SSLWantWriteError):
                return
            except OSError as error:
                raise _lost(error) from error
            if not data:
                raise TakLinkError(TakFault.CLOSED)
            if not self._has_spoken and data.strip():
                self._has_spoken = True
                if not data.lstrip().startswith(_FIRST_BYTES):
                    raise TakLinkError(TakFault.NONSENSE)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.close()


def _found(url: TakUrl, kind: socket.SocketKind) -> list[tuple[int, int, int, str, tuple[object, ...]]]:
    try:
        return socket.getaddrinfo(url.host, url.port, type=kind)  # type: ignore[return-value]
    except (OSError, UnicodeError) as error:
        raise TakLinkError(TakFault.NO_HOST, url.host) from error


def _connected(url: TakUrl) -> socket.socket:
    address = _found(url, socket.SOCK_STREAM)[0]
    made = socket.socket(address[0], socket.SOCK_STREAM)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            made.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNACKNOWLEDGED_MS)
        made.settimeout(CONNECT_S)
        made.connect(address[4])
    except TimeoutError as error:
        made.close()
        raise TakLinkError(TakFault.NO_ANSWER) from error
    except ConnectionRefusedError as error:
        made.close()
        raise TakLinkError(TakFault.REFUSED) from error
    except OSError as error:
        made.close()
        raise TakLinkError(TakFault.UNREACHABLE, error.strerror or "") from error
    return made


def _shaken(plain: socket.socket, context: ssl.SSLContext, name: str) -> ssl.SSLSocket:
    """With one time limit for the whole handshake, which a server may spin out byte by byte."""
    deadline_s = time.monotonic() + CONNECT_S
    secured = context.wrap_socket(plain, server_hostname=name, do_handshake_on_connect=False)
    with contextlib.ExitStack() as stack:
        stack.callback(secured.close)
        secured.settimeout(0.0)
        while not _is_shaken(secured, deadline_s - time.monotonic()):
            pass
        stack.pop_all()
    return secured


def _is_shaken(secured: ssl.SSLSocket, left_s: float) -> bool:
    """One step of the handshake; waits for the next one's bytes."""
    try:
        secured.do_handshake()
        return True
    except ssl.SSLWantReadError:
        ready = left_s > 0.0 and select.select([secured], [], [], left_s)[0]
    except ssl.SSLWantWriteError:
        ready = left_s > 0.0 and select.select([], [secured], [], left_s)[1]
    if not ready:
        raise TimeoutError
    return False


def _tls_error(error: Exception) -> TakLinkError:
    if isinstance(error, ssl.SSLCertVerificationError):
        return TakLinkError(TakFault.WRONG_CERTIFICATE, error.verify_message)
    if isinstance(error, TimeoutError):
        return TakLinkError(TakFault.NO_HANDSHAKE)
    if isinstance(error, ConnectionError | ssl.SSLEOFError | ssl.SSLZeroReturnError):
        return TakLinkError(TakFault.CLOSED, "in the handshake")
    if isinstance(error, ssl.SSLError) and "ALERT" in (error.reason or ""):
        return TakLinkError(TakFault.OUR_CERTIFICATE, _reason(error))
    return TakLinkError(TakFault.NOT_TLS, _reason(error))


def _lost(error: OSError) -> TakLinkError:
    """With TLS 1.3 a server says after the handshake that it wants another certificate of ours."""
    if isinstance(error, ssl.SSLError) and "ALERT" in (error.reason or ""):
        return TakLinkError(TakFault.OUR_CERTIFICATE, _reason(error))
    if isinstance(error, ssl.SSLError) and not isinstance(error, ssl.SSLEOFError | ssl.SSLZeroReturnError):
        return TakLinkError(TakFault.NOT_TLS, _reason(error))
    return TakLinkError(TakFault.CLOSED, "" if isinstance(error, ssl.SSLError) else error.strerror or "")


def _reason(error: Exception) -> str:
    return str(getattr(error, "reason", None) or error).lower().replace("_", " ")[:80]
