"""The service as the soak runs it, a process of its own: `python -m service.commands.soak.served CONFIG MEMORY LINK`.

It is what `distloc run` runs, but for the camera: in place of OpenCV's device a reader of the renderer's frames.
"""

import asyncio
import logging
import socket
import sys
import time
from pathlib import Path
from typing import Any

from service.camera.sources import CaptureSource
from service.commands.soak.frame_ring import FrameReader
from service.commands.soak.orders import follow
from service.common import aio
from service.common.process_end import run_process
from service.config.load import load_config
from service.flight.app import App


def main(config_file: str, memory: str, link: str) -> int:
    """Until standard input ends."""
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s", stream=sys.stderr)
    path = Path(config_file)
    config = load_config(path)
    slot_bytes = 3 * config.camera.width * config.camera.height
    reader = FrameReader(int(memory), socket.socket(fileno=int(link)), slot_bytes)

    def opened(_name: str) -> Any:
        return reader

    source = CaptureSource(
        "the renderer", 0, time.monotonic_ns, config.camera.camera(), open_capture=opened, is_awaited=True
    )
    aio.run(_serve(App(config, path.read_text(encoding="utf-8"), source=source)))
    return 0


async def _serve(app: App) -> None:
    loop, stop = asyncio.get_running_loop(), asyncio.Event()

    def end() -> None:
        loop.call_soon_threadsafe(stop.set)

    follow(lambda order: None, end)
    await app.run(stop)


if __name__ == "__main__":
    run_process(lambda: sys.exit(main(*sys.argv[1:])))
