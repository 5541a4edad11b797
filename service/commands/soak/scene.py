"""The soak's flight and the service's config for it."""

import json
from pathlib import Path

import msgspec

from service.config.sections import CameraConfig, MountConfig, SegmenterConfig
from service.simulator.chatter import attitude_hz, position_hz
from service.simulator.scenario import PathSection, PlumeSection, Scenario, service_config_toml

FRAMES_HZ = 10.0
# An orbit of 0.9 km and 200 s that never ends: one plume inside it stays in view and shows all its sides, two outside
# come and go. The plane banks by 5 degrees, and so the camera looks down by as much.
ORBIT = Scenario(
    path=PathSection(kind="arc", turn_rate_dps=1.8),
    targets=(
        PlumeSection(east_m=1000.0, north_m=150.0),
        PlumeSection(east_m=2400.0, north_m=1500.0),
        PlumeSection(east_m=-1100.0, north_m=-700.0, height_m=300.0),
    ),
    camera=CameraConfig(
        width=1280, height=720, fx=900.0, fy=900.0, cx=640.0, cy=360.0, mount=MountConfig(yaw_deg=90.0)
    ),
)


def orbit(speed: float) -> Scenario:
    """The flight with `speed` times the frames a second."""
    return msgspec.structs.replace(ORBIT, fps=FRAMES_HZ * speed)


def config_toml(
    scenario: Scenario,
    segmenter: SegmenterConfig,
    speed: float,
    n_particles: int,
    mavlink_port: int,
    endpoint: str,
    folder: Path,
) -> str:
    """A whole config file: the autopilot's link, the pilot's, zenoh, a recording and kept targets in `folder`."""
    return (
        service_config_toml(scenario, segmenter)
        + f"""
[mavlink]
attitude_hz = {attitude_hz(speed)}
position_hz = {position_hz(speed)}
[[mavlink.links]]
url = "udpin:127.0.0.1:{mavlink_port}"
[localizer]
n_particles = {n_particles}
[zenoh]
listen = ["{endpoint}"]
[recorder]
folder = {json.dumps(str(folder / "recording"))}
frames = false
[state]
dir = {json.dumps(str(folder / "state"))}
"""
    )
