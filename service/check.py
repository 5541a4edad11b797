"""`distloc check`: tries each part that a config names and says what is wrong and how to mend it."""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path

from service.autopilot import Autopilot
from service.config import Config, ConfigError
from service.dem import DemError, open_dem
from service.endpoint import parse_endpoint
from service.frames import SourceError, open_source
from service.mavlink_framer import Framer
from service.mavlink_link import Link, LinkError
from service.segment import make_segmenter

_LISTEN_S = 3.0

Say = Callable[[str], None]


async def run_check(config: Config, say: Say) -> bool:
    """Check config, model, camera, ground, links and clock; True if nothing failed."""
    say("ok    config")
    results = [_check_segmenter(config, say), _check_camera(config, say), _check_ground(config, say)]
    results.append(await _check_links(config, say))
    return all(results)


def _check_segmenter(config: Config, say: Say) -> bool:
    try:
        segmenter = make_segmenter(config.segmenter, config.camera.camera())
    except ConfigError as error:
        say(f"fail  segmenter: {error}")
        return False
    say(f"ok    segmenter: {segmenter.name}")
    return True


def _check_camera(config: Config, say: Say) -> bool:
    if config.camera.source.kind == "none":
        say("warn  camera: camera.source.kind is 'none': the service will see nothing; name a camera")
        return True
    try:
        with open_source(config.camera.source, config.camera.camera(), time.monotonic_ns) as source:
            frame = source.read()
    except SourceError as error:
        say(f"fail  camera: {error}")
        return False
    if frame is None or frame.image is None:
        say(f"fail  camera: {config.camera.source.path} gives no frame")
        return False
    say(f"ok    camera: {frame.image.shape[1]} x {frame.image.shape[0]}")
    return True


def _check_ground(config: Config, say: Say) -> bool:
    if config.ground.kind == "off":
        return True
    if config.localizer.filter == "bootstrap":
        say("warn  ground: localizer.filter is 'bootstrap', which takes no prior from the ground")
    if config.ground.kind == "flat":
        say(f"ok    ground: flat at home's altitude, +-{config.ground.height_sigma_m:g} m")
        return True
    try:
        tiles = open_dem(Path(config.ground.path))
    except DemError as error:
        say(f"fail  ground: {error}; give ground.path DEM files that can be read")
        return False
    say(f"ok    ground: {len(tiles)} DEM file{'s' * (len(tiles) > 1)} in {config.ground.path}")
    return True


async def _check_links(config: Config, say: Say) -> bool:
    if not config.mavlink.links:
        say("warn  link: mavlink.links is empty: no autopilot is heard; add one, e.g. udpin:127.0.0.1:14550")
        return True
    autopilot, framer = Autopilot(config.mavlink, config.camera.mount), Framer()

    def on_bytes(link: Link, data: bytes) -> None:
        for frame in framer.feed(data):
            autopilot.receive(frame, time.monotonic_ns())

    links = [Link(parse_endpoint(link.url), on_bytes) for link in config.mavlink.links]
    try:
        for link in links:
            await link.open()
    except LinkError as error:
        say(f"fail  link: {error}")
        return False
    tasks = [asyncio.create_task(link.run()) for link in links]
    end_s = time.monotonic() + _LISTEN_S
    while time.monotonic() < end_s:
        for data in autopilot.due(time.monotonic_ns()):
            for link in links:
                link.send(data)
        await asyncio.sleep(0.02)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return _say_heard(autopilot, say)


def _say_heard(autopilot: Autopilot, say: Say) -> bool:
    if not autopilot.target_system:
        say(f"fail  link: no autopilot heard in {_LISTEN_S:.0f} s; check the wiring, the baud rate and the port")
        return False
    say(f"ok    link: autopilot with system id {autopilot.target_system}")
    degraded = autopilot.degraded(time.monotonic_ns())
    if "clock" in degraded:
        say("warn  clock: no TIMESYNC replies; poses are timed by arrival only")
    else:
        say("ok    clock: TIMESYNC")
    if autopilot.frame_enu is None:
        say("warn  position: none that is valid yet; wait for a GPS fix")
    return True
