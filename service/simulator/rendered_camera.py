"""The demo's camera: frames rendered in a process of its own, stamped on the host's clock."""

import multiprocessing
import time
from collections import Counter
from multiprocessing.connection import Connection

import numpy as np

from distloc.types import RejectReason
from service.common.messages import Frame
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import Scenario

_POLL_S = 0.2


class RenderedCamera:
    """A frame source: `read` gives the frame of each period as soon as it is rendered, None once closed."""

    def __init__(self, scenario: Scenario, start_ns: int, seed: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe(duplex=False)
        self._process = context.Process(target=_render, args=(theirs, scenario, start_ns, seed), daemon=True)
        self._process.start()
        theirs.close()
        self._shape = (scenario.camera.height, scenario.camera.width, 3)
        self._closed = False
        self.rejected: Counter[RejectReason] = Counter()

    def read(self) -> Frame | None:
        """The next frame, or None once the source is closed."""
        while not self._closed:
            try:
                if not self._pipe.poll(_POLL_S):
                    continue
                stamp_ns = int.from_bytes(self._pipe.recv_bytes(8), "big")
                image = np.frombuffer(self._pipe.recv_bytes(), dtype=np.uint8).reshape(self._shape)
            except (EOFError, OSError):
                return None
            return Frame(stamp_ns, f"{stamp_ns}", image)
        return None

    def close(self) -> None:
        """End the process."""
        self._closed = True
        self._process.terminate()
        self._process.join()

    def __enter__(self) -> "RenderedCamera":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _render(pipe: Connection, scenario: Scenario, start_ns: int, seed: int) -> None:
    scene = DrawnScene(scenario, np.random.default_rng(seed))
    period_ns = round(1e9 / scenario.fps)
    while True:
        now_ns = time.monotonic_ns()
        index = max((now_ns - start_ns) // period_ns + 1, 0)
        stamp_ns = start_ns + index * period_ns
        time.sleep(max(stamp_ns - now_ns, 0) * 1e-9)
        image = scene.seen_at((stamp_ns - start_ns) * 1e-9)
        try:
            pipe.send_bytes(stamp_ns.to_bytes(8, "big"))
            pipe.send_bytes(image.tobytes())
        except OSError:
            return
