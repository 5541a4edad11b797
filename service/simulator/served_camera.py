"""A simulated camera as a network camera: JPEGs over HTTP, each given at the moment at which it was exposed."""

import contextlib
import multiprocessing
import signal
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from multiprocessing.connection import Connection

import numpy as np

from distloc.backports import Self
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import Scenario

_QUALITY = 92
_MOST_VIEWERS = 8
_POLL_S = 0.2
_LEAD_KEPT = 0.9  # of how long drawing took, from one picture to the next


class ServedCamera:
    """`http://HOST:PORT/` gives the stream (multipart JPEG) to at most eight at a time. OSError for a port in use.

    Frames are drawn ahead of their time by a process of its own, and a viewer that is slow misses some.
    """

    def __init__(self, scenario: Scenario, start_ns: int, seed: int, host: str, port: int) -> None:
        self._changed = threading.Condition()
        self._number, self._jpeg, self._is_over = 0, b"", False
        self._viewers = threading.Semaphore(_MOST_VIEWERS)
        camera = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                camera._serve(self)

            def log_message(self, *_: object) -> None:
                """Nothing."""

        self._server = ThreadingHTTPServer((host, port), Handler)
        self._server.daemon_threads = True
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_draw, args=(theirs, scenario, start_ns, seed), daemon=True)
        self._process.start()
        theirs.close()
        self._threads = [
            threading.Thread(target=self._server.serve_forever, name="http", daemon=True),
            threading.Thread(target=self._take, name="frames", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def url(self) -> str:
        """What camera.source.path is."""
        host, port = self._server.server_address[:2]
        return f"http://{host!s}:{port}/"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        with self._changed:
            self._is_over = True
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()
        self._process.terminate()
        self._process.join()
        for thread in self._threads:
            thread.join()

    def _take(self) -> None:
        while not self._is_over:
            try:
                if not self._pipe.poll(_POLL_S):
                    continue
                jpeg = self._pipe.recv_bytes()
            except (EOFError, OSError):
                return
            with self._changed:
                self._number, self._jpeg = self._number + 1, jpeg
                self._changed.notify_all()

    def _serve(self, request: BaseHTTPRequestHandler) -> None:
        if not self._viewers.acquire(blocking=False):
            request.send_error(503, "too many viewers")
            return
        try:
            with contextlib.suppress(OSError):  # the viewer has gone
                request.send_response(200)
                request.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                request.end_headers()
                self._stream(request)
        finally:
            self._viewers.release()

    def _stream(self, request: BaseHTTPRequestHandler) -> None:
        with self._changed:
            seen = self._number  # the last picture is of the past: only what comes from now on is shown
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._number > seen or self._is_over)  # noqa: B023
                if self._is_over:
                    return
                seen, jpeg = self._number, self._jpeg
            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
            request.wfile.write(head.encode() + jpeg + b"\r\n")


def _draw(pipe: Connection, scenario: Scenario, start_ns: int, seed: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of the terminal: the parent ends this process
    scene = DrawnScene(scenario, np.random.default_rng(seed))
    period_ns = round(1e9 / scenario.fps)
    lead_ns, index = period_ns, 0
    while True:
        begun_ns = time.monotonic_ns()
        # as far ahead as drawing takes: a slow computer gives fewer pictures, none of them late
        index = max(index + 1, (begun_ns - start_ns + lead_ns) // period_ns + 1)
        stamp_ns = start_ns + index * period_ns
        image, _ = scene.at((stamp_ns - start_ns) * 1e-9)
        data = scene.jpeg(image, _QUALITY)
        took_ns = time.monotonic_ns() - begun_ns
        lead_ns = max(2 * took_ns, round(_LEAD_KEPT * lead_ns))
        early_ns = stamp_ns - begun_ns - took_ns
        if early_ns < 0:
            continue  # a picture of the past would be taken for one of now
        time.sleep(early_ns * 1e-9)
        try:
            pipe.send_bytes(data)
        except OSError:
            return
