"""Nothing listens unless configured: the real service in a process of its own, its sockets read from /proc."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.support.open_sockets import OpenSocket, open_sockets
from tests.support.places import HANG_S
from tests.support.ports import free_port
from tests.support.running_app import ticks_now

KEY = bytes(range(32))


@contextmanager
def service(folder: Path, text: str, **environment: str) -> Iterator[int]:
    """The process id of `run` with this config, once it says on $NOTIFY_SOCKET that it is ready."""
    config, told = folder / "config.toml", folder / "notify"
    config.write_text(text)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        notify.bind(str(told))
        notify.settimeout(HANG_S)
        env = {**os.environ, "NOTIFY_SOCKET": str(told), **environment}
        with subprocess.Popen([sys.executable, "-m", "service", "run", "--config", str(config)], env=env) as process:
            killer = threading.Timer(2 * HANG_S, process.kill)
            killer.start()
            try:
                assert notify.recv(100) == b"READY=1"
                for _ in range(3):  # sent once a second: the session and the links had time to open what they open
                    assert notify.recv(1000).startswith(b"WATCHDOG=1")
                yield process.pid
            finally:
                process.send_signal(signal.SIGTERM)
                process.wait(HANG_S)
                killer.cancel()
        assert process.returncode == 0


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[zenoh]\nenabled = false",
        '[zenoh]\nconnect = ["tcp/127.0.0.1:9"]',
        '[[mavlink.links]]\nurl = "udpout:127.0.0.1:9"',
        '[[mavlink.links]]\nurl = "tcp:127.0.0.1:9"',
    ],
)
def test_nothing_listens_by_default_nor_where_the_service_calls_out(tmp_path: Path, text: str) -> None:
    with service(tmp_path, text) as pid:
        assert open_sockets(pid) == set()


def test_what_is_configured_listens_there_and_nowhere_else(tmp_path: Path) -> None:
    udp, tcp, zenoh = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM)
    text = f"""
        [[mavlink.links]]
        url = "udpin:127.0.0.1:{udp}"
        [[mavlink.links]]
        url = "tcpin:127.0.0.1:{tcp}"
        [zenoh]
        listen = ["tcp/127.0.0.1:{zenoh}"]
    """
    with service(tmp_path, text) as pid:
        assert open_sockets(pid) == {
            OpenSocket("udp", "127.0.0.1", udp),
            OpenSocket("tcp", "127.0.0.1", tcp),
            OpenSocket("tcp", "127.0.0.1", zenoh),
        }


def test_the_reader_of_proc_sees_what_listens_anywhere() -> None:
    with socket.socket(socket.AF_INET) as tcp, socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as udp:
        tcp.bind(("", 0))
        tcp.listen()
        udp.bind(("::1", 0))
        assert {
            OpenSocket("tcp", "0.0.0.0", tcp.getsockname()[1]),
            OpenSocket("udp6", "::1", udp.getsockname()[1]),
        } <= open_sockets(os.getpid())


def test_the_process_signs_with_a_systemd_credential(tmp_path: Path) -> None:
    """An autopilot that signs with the key is answered, in signed frames."""
    (tmp_path / "mavlink-signing-key").write_bytes(KEY)
    port = free_port(socket.SOCK_DGRAM)
    text = f'[mavlink]\nsigning_key = "credential:mavlink-signing-key"\nlinks = [{{ url = "udpin:127.0.0.1:{port}" }}]'
    mav = mavlink.MAVLink(None, 1, 1)
    mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.timestamp = KEY, True, ticks_now()
    with (
        service(tmp_path, text, CREDENTIALS_DIRECTORY=str(tmp_path)),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot,
    ):
        autopilot.settimeout(HANG_S)
        beat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3)
        autopilot.sendto(bytes(beat.pack(mav)), ("127.0.0.1", port))
        while mav.signing.goodsig_count < 5:
            mav.parse_buffer(autopilot.recv(2048))
        assert mav.signing.badsig_count == 0 == mav.signing.unsigned_count


def test_the_process_refuses_a_key_that_others_can_read(tmp_path: Path) -> None:
    key, config = tmp_path / "key", tmp_path / "config.toml"
    key.write_bytes(KEY)
    key.chmod(0o644)
    config.write_text(f'[mavlink]\nsigning_key = "{key}"\nlinks = [{{ url = "udpin:127.0.0.1:0" }}]')
    command = [sys.executable, "-m", "service", "run", "--config", str(config)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode == 78
    assert done.stderr == f"distloc: mavlink.signing_key is '{key}': its mode is 0644, must be 0600: chmod 600 it\n"
