"""The flight of the fault tests: round a plume, so that it stays in view and is confirmed within seconds."""

from service.config.sections import CameraConfig, MountConfig
from service.simulator.scenario import PathSection, PlumeSection, Scenario

FPS = 5.0
ROUND_THE_PLUME = Scenario(
    path=PathSection(kind="arc", speed_mps=60.0, turn_rate_dps=3.4),
    targets=(PlumeSection(east_m=880.0, north_m=120.0),),
    camera=CameraConfig(
        width=320, height=180, fx=225.0, fy=225.0, cx=160.0, cy=90.0, mount=MountConfig(yaw_deg=90.0, pitch_deg=15.0)
    ),
    fps=FPS,
)
