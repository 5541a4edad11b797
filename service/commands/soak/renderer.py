"""The soak's camera, a process: `python -m service.commands.soak.renderer SCENARIO START_NS SEED MEMORY LINK`.

A frame is drawn for the moment at which it will be handed over, and handed over at that moment.
"""

import collections
import socket
import sys
import threading
import time
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np

from service.commands.soak.frame_ring import FrameWriter
from service.commands.soak.orders import follow
from service.simulator.scenario import Scenario
from service.simulator.spoilable_camera import SpoilableCamera

_LATE_NS = 10_000_000  # 0.3 m of flight: as far as the pose may be from the frame's
_SPARE_NS = 5_000_000
_REMEMBERED = 30  # drawing times
_SHARE = 90.0  # percent of them that are short enough: with all of them a single slow one would cost many frames
_SHRINK = 2  # 15 ms a frame in place of 50: the shipped model looks at no more pixels than these (360 rows)


def main(scenario_file: str, start_ns: str, seed: str, memory: str, link: str) -> int:
    """Until standard input ends."""
    cv2.setNumThreads(1)  # the other cores are the service's
    scenario = msgspec.json.decode(Path(scenario_file).read_bytes(), type=Scenario)
    camera = SpoilableCamera(scenario, int(start_ns), int(seed), _SHRINK)
    slot_bytes = 3 * scenario.camera.width * scenario.camera.height
    writer = FrameWriter(int(memory), socket.socket(fileno=int(link)), slot_bytes)
    lost, ended = threading.Event(), threading.Event()

    def obey(order: dict[str, Any]) -> None:
        for name, value in order.items():
            if name == "is_lost":
                (lost.set if value else lost.clear)()
            else:
                setattr(camera, name, value)

    follow(obey, ended.set)
    _draw(camera, writer, int(start_ns), round(1e9 / scenario.fps), lost, ended)
    return 0


def _draw(
    camera: SpoilableCamera,
    writer: FrameWriter,
    start_ns: int,
    period_ns: int,
    lost: threading.Event,
    ended: threading.Event,
) -> None:
    took_ns: collections.deque[int] = collections.deque([period_ns // 2], _REMEMBERED)
    done = -1
    while not ended.is_set():
        begun_ns = time.monotonic_ns()
        lead_ns = int(np.percentile(took_ns, _SHARE)) + _SPARE_NS
        index = max((begun_ns + lead_ns - start_ns) // period_ns, done + 1)
        due_ns = start_ns + index * period_ns
        if ended.wait(max(due_ns - lead_ns - begun_ns, 0) * 1e-9):
            return
        done = index
        if lost.is_set():
            continue
        drawing_ns = time.monotonic_ns()
        writer.put(camera.picture(due_ns))
        took_ns.append(time.monotonic_ns() - drawing_ns)
        time.sleep(max(due_ns - time.monotonic_ns(), 0) * 1e-9)
        now_ns = time.monotonic_ns()
        if now_ns - due_ns > _LATE_NS:
            writer.drop()
        elif not writer.hand_over(now_ns):
            return


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
