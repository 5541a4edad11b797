"""What the service is loaded with while it is measured: an autopilot's messages and a camera's stream; for `bench`."""

import contextlib
import itertools
import select
import socket
import threading
import time
from collections.abc import Callable, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

# Messages a second of a mix as ArduPilot sends on a fast link, 500 in all.
MIX_HZ = {
    "attitude": 50, "global_position_int": 20, "heartbeat": 1, "gps_raw_int": 2, "ekf_status_report": 2,
    "system_time": 1, "raw_imu": 100, "scaled_imu2": 100, "vfr_hud": 50, "servo_output_raw": 50, "rc_channels": 25,
    "nav_controller_output": 20, "local_position_ned": 20, "sys_status": 10, "vibration": 10, "scaled_pressure": 10,
    "power_status": 10, "ahrs": 10, "battery_status": 8, "meminfo": 1,
}  # fmt: skip
_BOOTED_BEFORE_NS = 60_000_000_000


class Peer:
    """A hovering autopilot on a UDP socket: sends each kind of message so often, evenly spread, from a thread.

    Several messages may share a datagram. It answers TIMESYNC and acknowledges commands. `sent` counts the messages of
    the mix, `sent_bytes` all that left.
    """

    def __init__(
        self, port: int, rates_hz: dict[str, int], place: tuple[float, float, float], per_datagram: int = 1
    ) -> None:
        self.sent = self.sent_bytes = 0
        self._mav = mavlink.MAVLink(None, 1, 1)
        self._parser = mavlink.MAVLink(None)
        self._lat_deg, self._lon_deg, self._alt_m = place
        self._start_ns = time.monotonic_ns() - _BOOTED_BEFORE_NS
        slots = sorted(((k + 0.5) / hz, kind) for kind, hz in rates_hz.items() for k in range(hz))
        self._makers: list[Callable[[], Any]] = [self._maker(kind) for _, kind in slots]
        self._per_datagram = per_datagram
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.setblocking(False)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="peer", daemon=True)

    def __enter__(self) -> "Peer":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        due_s, waiting = time.monotonic(), b""
        for number, make in enumerate(itertools.cycle(self._makers), 1):
            while (left_s := due_s - time.monotonic()) > 0.0:
                self._answer(left_s)
            if self._ended.is_set():
                return
            waiting += self._packed(make())
            if number % self._per_datagram == 0:
                self._send(waiting)
                waiting = b""
            self.sent += 1
            due_s += 1.0 / len(self._makers)

    def _answer(self, wait_s: float) -> None:
        if not select.select([self._socket], [], [], wait_s)[0]:
            return
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            for message in self._parser.parse_buffer(self._socket.recv(65535)) or []:
                if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                    self._send(self._packed(mavlink.MAVLink_timesync_message(self._boot_ns(), message.ts1)))
                elif message.get_type() == "COMMAND_LONG":
                    self._send(self._packed(mavlink.MAVLink_command_ack_message(message.command, 0)))

    def _send(self, data: bytes) -> None:
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            self._socket.send(data)
            self.sent_bytes += len(data)

    def _packed(self, message: Any) -> bytes:
        packed = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed

    def _boot_ns(self) -> int:
        return time.monotonic_ns() - self._start_ns

    def _boot_ms(self) -> int:
        return self._boot_ns() // 1_000_000

    def _maker(self, kind: str) -> Callable[[], Any]:
        blank = None if hasattr(self, f"_{kind}") else _blank(kind)
        return getattr(self, f"_{kind}") if blank is None else lambda: blank

    def _heartbeat(self) -> Any:
        return mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4, 3)

    def _attitude(self) -> Any:
        return mavlink.MAVLink_attitude_message(self._boot_ms(), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def _global_position_int(self) -> Any:
        place = (round(self._lat_deg * 1e7), round(self._lon_deg * 1e7), round(self._alt_m * 1e3))
        return mavlink.MAVLink_global_position_int_message(self._boot_ms(), *place, 120_000, 0, 0, 0, 0)

    def _gps_raw_int(self) -> Any:
        place = (round(self._lat_deg * 1e7), round(self._lon_deg * 1e7), round(self._alt_m * 1e3))
        return mavlink.MAVLink_gps_raw_int_message(self._boot_ns() // 1000, 3, *place, 80, 120, 0, 0, 14)

    def _ekf_status_report(self) -> Any:
        return mavlink.MAVLink_ekf_status_report_message(831, 0.05, 0.05, 0.05, 0.05, 0.0)

    def _system_time(self) -> Any:
        return mavlink.MAVLink_system_time_message(time.time_ns() // 1000, self._boot_ms())


def _blank(kind: str) -> Any:
    """A message that nobody reads: each number is 7, so that no byte is cut as a trailing zero."""
    made = getattr(mavlink, f"MAVLink_{kind}_message")
    counts = dict(zip(made.ordered_fieldnames, made.array_lengths, strict=True))
    return made(*([7] * counts[name] if counts[name] else 7 for name in made.fieldnames))


class Stream:
    """A camera's MJPEG stream over HTTP on loopback: the JPEGs in turn, so many a second, to whoever connects."""

    def __init__(self, pictures: Sequence[bytes], fps: float) -> None:
        ended = self._ended = threading.Event()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                with contextlib.suppress(OSError):
                    for jpeg in itertools.cycle(pictures):
                        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                        self.wfile.write(head.encode() + jpeg + b"\r\n")
                        if ended.wait(1.0 / fps):
                            return

            def log_message(self, *_: object) -> None:
                """Says nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True)

    def __enter__(self) -> "Stream":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()
