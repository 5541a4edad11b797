"""Writes a recording of a simulated flight, with its truth, as fast as it can be drawn; `distloc simulate` calls it."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import msgspec
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.config.sections import MavlinkConfig
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import Scenario, service_config_toml, truth_json
from service.simulator.simulated_autopilot import COMPONENT, SYSTEM, UTC_START_S, SimulatedAutopilot

_COMPANION = 191
_TICK_S = 0.1  # of the companion, which asks TIMESYNC as often
_TICKS_A_HEARTBEAT = 10
_JPEG_QUALITY = 92
_DEFAULTS = MavlinkConfig()
_RATES_HZ = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _DEFAULTS.attitude_hz,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _DEFAULTS.position_hz,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.2,
}


def simulate(out: Path, scenario: Scenario, seed: int, progress: Callable[[float], None]) -> None:
    """Write the recording `out`, which appears when it is complete; the same seed gives the same bytes.

    `progress` is told the share done, 0 to 1. Raises FileExistsError if `out` exists and is not an empty folder.
    """
    out = out.resolve()
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileExistsError(f"{out} exists and is not an empty folder: give another name or remove it")
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    part.mkdir(parents=True)
    try:
        _write(part, scenario, seed, progress)
        os.replace(part, out)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _write(folder: Path, scenario: Scenario, seed: int, progress: Callable[[float], None]) -> None:
    autopilot_rng, landscape_rng = np.random.default_rng(seed).spawn(2)
    (folder / "config.toml").write_text(service_config_toml(scenario), encoding="utf-8")
    (folder / "truth.json").write_bytes(
        msgspec.json.format(msgspec.json.encode(truth_json(scenario)), indent=1) + b"\n"
    )
    with (folder / "telemetry.tlog").open("wb") as tlog:
        for t_s, frame in telemetry(scenario, autopilot_rng):
            tlog.write(stamp_us(t_s).to_bytes(8, "big") + frame)
    _write_frames(folder, scenario, landscape_rng, progress)


def stamp_us(t_s: float) -> int:
    """The log's clock at a scenario's time."""
    return round(UTC_START_S) * 1_000_000 + round(t_s * 1e6)


def telemetry(scenario: Scenario, rng: np.random.Generator) -> Iterator[tuple[float, bytes]]:
    """What the companion's end of the link heard and sent until the flight's end: (t_s, frame) in order of time."""
    autopilot, companion = SimulatedAutopilot(scenario, rng), _Companion()
    on_the_way: list[tuple[float, bytes]] = []
    for tick in range(int(scenario.duration_s / _TICK_S) + 1):
        t_s = tick * _TICK_S
        on_the_way += autopilot.due(t_s)
        arrived = [item for item in on_the_way if item[0] <= t_s]
        on_the_way = on_the_way[len(arrived) :]
        yield from arrived
        for _, frame in arrived:
            companion.hear(frame)
        for frame in companion.tick(tick, t_s):
            autopilot.receive(frame, t_s)
            yield t_s, frame


class _Companion:
    """Asks an autopilot that it has heard for rates and for its clock, as the service does."""

    def __init__(self) -> None:
        self._mav = mavlink.MAVLink(None, SYSTEM, _COMPANION)
        self._parser = mavlink.MAVLink(None)
        self._has_heard = self._has_asked = False
        self._to_answer: list[int] = []

    def hear(self, frame: bytes) -> None:
        """Take one frame of the autopilot's."""
        for message in self._parser.parse_buffer(frame) or []:
            self._has_heard = True
            if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                self._to_answer.append(message.ts1)

    def tick(self, number: int, t_s: float) -> Iterator[bytes]:
        """What it sends now."""
        if number % _TICKS_A_HEARTBEAT == 0:
            yield self._packed(
                self._mav.heartbeat_encode(
                    mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE
                )
            )
        if not self._has_heard:
            return
        now_ns = stamp_us(t_s) * 1000
        for ts1 in self._to_answer:
            yield self._packed(self._mav.timesync_encode(now_ns, ts1))
        self._to_answer.clear()
        if not self._has_asked:
            yield from map(self._request, _RATES_HZ)
            self._has_asked = True
        yield self._packed(self._mav.timesync_encode(0, now_ns))

    def _request(self, message_id: int) -> bytes:
        interval_us = 1e6 / _RATES_HZ[message_id]
        command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        return self._packed(
            self._mav.command_long_encode(SYSTEM, COMPONENT, command, 0, message_id, interval_us, 0, 0, 0, 0, 0)
        )

    def _packed(self, message: mavlink.MAVLink_message) -> bytes:
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame


def _write_frames(
    folder: Path, scenario: Scenario, rng: np.random.Generator, progress: Callable[[float], None]
) -> None:
    (folder / "frames").mkdir()
    (folder / "masks").mkdir()
    scene = DrawnScene(scenario, rng)
    count = max(1, int(scenario.duration_s * scenario.fps))
    lines = ["stamp_us,file\n"]
    for number in range(count):
        t_s = number / scenario.fps
        image, mask = scene.at(t_s)
        (folder / "frames" / f"{number:06d}.jpg").write_bytes(scene.jpeg(image, _JPEG_QUALITY))
        (folder / "masks" / f"{number:06d}.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())
        lines.append(f"{stamp_us(t_s)},{number:06d}.jpg\n")
        progress((number + 1) / count)
    (folder / "frames.csv").write_text("".join(lines), encoding="utf-8")
