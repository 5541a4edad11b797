"""`distloc autopilot`: a simulated drone that anything can listen to: MAVLink over UDP, a camera over HTTP."""

import contextlib
import json
import signal
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from service.simulator.begun_anew import BegunAnew
from service.simulator.on_air import serve
from service.simulator.scenario import Scenario, service_config_toml
from service.simulator.served_camera import ServedCamera
from service.simulator.simulated_autopilot import SimulatedAutopilot

LATENCY_MS = 5.0  # from a picture's moment to its arrival; measured on loopback: 2 to 10
Say = Callable[[str], None]
Endpoint = tuple[str, int]


class LiveError(Exception):
    """The drone cannot be put where it was asked for: one line that names the option."""


def parse_host_port(text: str) -> Endpoint:
    """HOST:PORT, the host in brackets or not; ValueError in one line else."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ValueError(f"{text!r} must be HOST:PORT with a port of 1 to 65535")
    return host.strip("[]"), int(port)


def live_config_toml(scenario: Scenario, link: Endpoint, camera: Endpoint | None, pictures: Path | None = None) -> str:
    """The config of a service that hears this drone, sees through its camera and serves zenoh on this computer.

    Its camera is the folder of `pictures` where there is one, else the stream at `camera`.
    """
    parts = [
        "# The service's config for the drone that `distloc autopilot` simulates.",
        service_config_toml(scenario),
        f'[[mavlink.links]]\nurl = "udpin:{link[0]}:{link[1]}"\n',
    ]
    if pictures is not None:
        path = json.dumps(str(pictures.absolute()))
        parts.append(f'[camera.source]\nkind = "folder"\npath = {path}\nfps = {scenario.fps}\n')
    elif camera is not None:
        parts.append(
            f'[camera.source]\nkind = "rtsp"  # any network stream\npath = "http://{camera[0]}:{camera[1]}/"\n'
            f"fps = {scenario.fps}\nlatency_ms = {LATENCY_MS}\n"
        )
    parts.append('[zenoh]\nlisten = ["tcp/127.0.0.1:7447"]\n')
    return "\n".join(parts)


def write_config(path: Path, text: str) -> None:
    """A new file; FileExistsError where there is one."""
    with path.open("x", encoding="utf-8") as file:
        file.write(text)


def fly(
    scenario: Scenario,
    seed: int,
    connect: Sequence[Endpoint],
    camera: Endpoint | None,
    say: Say,
    is_begun_anew: bool = False,
) -> None:
    """Fly until SIGTERM or SIGINT, from the start again with each service if told so.

    LiveError for an address that is none or a port in use.
    """
    stop, stopper = socket.socketpair()
    stopper.setblocking(False)
    with contextlib.ExitStack() as stack:
        stack.enter_context(stop)
        stack.enter_context(stopper)
        for number in (signal.SIGTERM, signal.SIGINT):
            stack.callback(signal.signal, number, signal.signal(number, lambda *_: _told(stopper)))
        links = [stack.enter_context(_link(endpoint)) for endpoint in connect]
        start_ns = time.monotonic_ns()
        if camera is not None:
            served = stack.enter_context(_served(scenario, start_ns, seed, camera))
            say(f"camera: {served.url}")
        for host, port in connect:
            say(f"MAVLink: to UDP port {port} of {host}")
        for target in scenario.targets:
            lat_deg, lon_deg, _ = scenario.frame.geodetic_from_enu(target.plume.base_enu_m)
            say(f"fire: {lat_deg:.5f} {lon_deg:.5f}")
        say("flying until Ctrl-C")

        def made(booted_before_s: float) -> SimulatedAutopilot:
            return SimulatedAutopilot(scenario, np.random.default_rng(seed), time.time(), booted_before_s)

        autopilot = BegunAnew(made) if is_begun_anew else made(90.0)
        serve(autopilot, links, start_ns, float("inf"), stop)


def _told(stopper: socket.socket) -> None:
    with contextlib.suppress(BlockingIOError):
        stopper.send(b"s")


def _served(scenario: Scenario, start_ns: int, seed: int, camera: Endpoint) -> ServedCamera:
    try:
        return ServedCamera(scenario, start_ns, seed, *camera)
    except OSError as error:
        raise LiveError(f"--camera {camera[0]}:{camera[1]}: {error.strerror or error}") from error


def _link(endpoint: Endpoint) -> socket.socket:
    try:
        kind, *_, address = socket.getaddrinfo(*endpoint, type=socket.SOCK_DGRAM)[0]
    except OSError as error:
        raise LiveError(f"--connect {endpoint[0]}:{endpoint[1]}: {error.strerror or error}") from error
    link = socket.socket(kind, socket.SOCK_DGRAM)
    link.connect(address)
    link.setblocking(False)
    return link
