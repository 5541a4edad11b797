"""An ArduCopter as its link shows it, without I/O; and the process that puts one on a UDP socket for `demo`."""

import argparse
import signal
import socket
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.simulation.errors import AutopilotErrors
from distloc.simulation.paths import VehicleTruth
from service.common.shown import shown
from service.config.sections import ConfigError
from service.simulator.on_air import serve
from service.simulator.scenario import Scenario, load_scenario

UTC_START_S = 1_780_000_000.0  # the scenario's own date, where nothing says another
SYSTEM, COMPONENT = 1, 1
_BOOTED_BEFORE_S = 90.0
_CLOCK_DRIFT = 20e-6  # of a crystal
_LOOP_S = 0.0025  # ArduCopter's main loop: a reply leaves one later than its request came (FACTS.md)
_SHORTEST_INTERVAL_S = _LOOP_S / 0.8
_TIMESYNC_INTERVAL_S = 10.0
_EKF_NOMINAL = 831
_RATE_STEP_S = 0.02  # over which the body's rates are differenced


@dataclass(slots=True)
class Stream:
    """One message that is sent at an interval."""

    interval_s: float
    next_s: float


class SimulatedAutopilot:
    """Takes the bytes that a companion sends and gives those that arrive at it, by a time `t_s` that the caller owns.

    Both directions are delayed by a uniform `latency_ms` and keep their order. Calls must not go back in time.
    """

    def __init__(
        self,
        scenario: Scenario,
        rng: np.random.Generator,
        utc_start_s: float = UTC_START_S,
        booted_before_s: float = _BOOTED_BEFORE_S,
    ) -> None:
        self._scenario, self._rng, self._utc_start_s = scenario, rng, utc_start_s
        self._booted_before_s = booted_before_s
        self._flight, self._frame = scenario.flight, scenario.frame
        self._errors = _estimator(scenario, rng)
        self._mav = mavlink.MAVLink(None, SYSTEM, COMPONENT)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._incoming: list[tuple[float, bytes]] = []
        self._incoming_s = self._outgoing_s = 0.0
        self._pack: dict[int, Callable[[float], mavlink.MAVLink_message]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._timesync_request,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps_raw,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._ekf_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home_position,
        }
        self._streams = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: Stream(1.0, 0.0),
            mavlink.MAVLINK_MSG_ID_TIMESYNC: Stream(_TIMESYNC_INTERVAL_S, 0.5),
        }

    def boot_ns(self, t_s: float) -> int:
        """The autopilot's own clock: nanoseconds since its boot."""
        return int((t_s + self._booted_before_s) * (1.0 + _CLOCK_DRIFT) * 1e9)

    def receive(self, data: bytes, t_s: float) -> None:
        """Take bytes that the companion put on the link at `t_s`."""
        self._incoming_s = max(self._incoming_s, t_s + self._latency_s())
        self._incoming.append((self._incoming_s, data))

    def due(self, t_s: float) -> list[tuple[float, bytes]]:
        """Frames that were packed up to `t_s`, each with the time at which it arrives, in order."""
        out: list[tuple[float, bytes]] = []
        while True:
            message_id, stream = min(self._streams.items(), key=lambda item: item[1].next_s)
            arrival_s = self._incoming[0][0] if self._incoming else np.inf
            if min(arrival_s, stream.next_s) > t_s:
                return out
            if arrival_s <= stream.next_s:
                out.extend(self._handle(*self._incoming.pop(0)))
            else:
                out.append(self._send(self._pack[message_id](stream.next_s), stream.next_s))
                stream.next_s += stream.interval_s

    def _handle(self, arrival_s: float, data: bytes) -> list[tuple[float, bytes]]:
        replies = (self._reply(message, arrival_s) for message in self._parser.parse_buffer(data) or [])
        return [self._send(reply, arrival_s + _LOOP_S) for reply in replies if reply is not None]

    def _reply(self, message: mavlink.MAVLink_message, arrival_s: float) -> mavlink.MAVLink_message | None:
        kind = message.get_type()
        if kind == "TIMESYNC" and message.tc1 == 0:
            return self._mav.timesync_encode(self.boot_ns(arrival_s), message.ts1)
        if (
            kind == "COMMAND_LONG"
            and message.target_system in (0, SYSTEM)
            and message.target_component in (0, COMPONENT)
        ):
            result = self._command(message, arrival_s)
            return self._mav.command_ack_encode(
                message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        return None

    def _command(self, message: mavlink.MAVLink_message, arrival_s: float) -> int:
        if message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            accepted = self._set_interval(int(message.param1), message.param2 * 1e-6, arrival_s)
            return int(mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_DENIED)
        return int(mavlink.MAV_RESULT_UNSUPPORTED)

    def _set_interval(self, message_id: int, interval_s: float, arrival_s: float) -> bool:
        if message_id not in self._pack or message_id == mavlink.MAVLINK_MSG_ID_TIMESYNC:
            return False
        if interval_s <= 0.0:  # -1 switches off; 0 asks for the default, which for all but HEARTBEAT is off
            if message_id != mavlink.MAVLINK_MSG_ID_HEARTBEAT:
                self._streams.pop(message_id, None)
            return True
        if interval_s < _SHORTEST_INTERVAL_S:
            return False
        stream = self._streams.setdefault(message_id, Stream(interval_s, arrival_s + interval_s))
        stream.interval_s, stream.next_s = interval_s, min(stream.next_s, arrival_s + interval_s)
        return True

    def _send(self, message: mavlink.MAVLink_message, packed_s: float) -> tuple[float, bytes]:
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        self._outgoing_s = max(self._outgoing_s, packed_s + self._latency_s())
        return self._outgoing_s, frame

    def _latency_s(self) -> float:
        low_ms, high_ms = self._scenario.errors.latency_ms
        return float(self._rng.uniform(low_ms, high_ms)) * 1e-3

    def _boot_ms(self, t_s: float) -> int:
        return self.boot_ns(t_s) // 1_000_000 % 2**32

    def _estimate(self, t_s: float) -> VehicleTruth:
        return self._errors.perturb(self._flight.state(t_s), t_s)

    def _heartbeat(self, _t_s: float) -> mavlink.MAVLink_message:
        mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return self._mav.heartbeat_encode(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mode, 4, mavlink.MAV_STATE_ACTIVE
        )

    def _timesync_request(self, t_s: float) -> mavlink.MAVLink_message:
        return self._mav.timesync_encode(0, self.boot_ns(t_s))

    def _attitude(self, t_s: float) -> mavlink.MAVLink_message:
        now = self._estimate(t_s)
        yaw_rad = _wrapped(now.yaw_rad)
        rates = _body_rates(self._flight.state(t_s), self._flight.state(t_s + _RATE_STEP_S))
        return self._mav.attitude_encode(self._boot_ms(t_s), now.roll_rad, now.pitch_rad, yaw_rad, *rates)

    def _global_position(self, t_s: float) -> mavlink.MAVLink_message:
        now = self._estimate(t_s)
        lat_deg, lon_deg, alt_msl_m = self._frame.geodetic_from_enu(now.position_enu_m)
        east_mps, north_mps, up_mps = now.velocity_enu_mps
        return self._mav.global_position_int_encode(
            self._boot_ms(t_s),
            round(lat_deg * 1e7),
            round(lon_deg * 1e7),
            round(alt_msl_m * 1e3),
            round(now.position_enu_m[2] * 1e3),
            round(north_mps * 100),
            round(east_mps * 100),
            round(-up_mps * 100),
            round(np.degrees(now.yaw_rad) % 360.0 * 100) % 36000,
        )

    def _gps_raw(self, t_s: float) -> mavlink.MAVLink_message:
        now = self._estimate(t_s)
        lat_deg, lon_deg, alt_msl_m = self._frame.geodetic_from_enu(now.position_enu_m)
        east_mps, north_mps, _ = now.velocity_enu_mps
        course_cdeg = round(np.degrees(np.arctan2(east_mps, north_mps)) % 360.0 * 100) % 36000
        sigma_mm = round(self._scenario.errors.position_sigma_m * 1e3)
        return self._mav.gps_raw_int_encode(
            self.boot_ns(t_s) // 1000,
            mavlink.GPS_FIX_TYPE_3D_FIX,
            round(lat_deg * 1e7),
            round(lon_deg * 1e7),
            round(alt_msl_m * 1e3),
            80,
            120,
            round(float(np.hypot(east_mps, north_mps)) * 100),
            course_cdeg,
            14,
            round((alt_msl_m + self._scenario.origin.geoid_m) * 1e3),
            sigma_mm,
            sigma_mm,
        )

    def _ekf_status(self, _t_s: float) -> mavlink.MAVLink_message:
        return self._mav.ekf_status_report_encode(_EKF_NOMINAL, 0.05, 0.05, 0.05, 0.05, 0.0, 0.0)

    def _system_time(self, t_s: float) -> mavlink.MAVLink_message:
        return self._mav.system_time_encode(round((self._utc_start_s + t_s) * 1e6), self._boot_ms(t_s))

    def _home_position(self, t_s: float) -> mavlink.MAVLink_message:
        origin = self._scenario.origin
        return self._mav.home_position_encode(
            round(origin.lat_deg * 1e7),
            round(origin.lon_deg * 1e7),
            round(origin.alt_msl_m * 1e3),
            0.0,
            0.0,
            0.0,
            [1.0, 0.0, 0.0, 0.0],
            0.0,
            0.0,
            0.0,
            self.boot_ns(t_s) // 1000,
        )


def _estimator(scenario: Scenario, rng: np.random.Generator) -> AutopilotErrors:
    errors = scenario.errors
    white_rad = float(np.radians(errors.attitude_white_deg))
    return AutopilotErrors(
        rng,
        heading_bias_rad=float(np.radians(errors.heading_bias_deg)),
        heading_white_rad=white_rad,
        tilt_bias_rad=float(np.radians(errors.tilt_bias_deg)),
        tilt_white_rad=white_rad,
        position_bias_m=errors.position_sigma_m,
        position_white_m=0.1 * errors.position_sigma_m,  # an EKF's position is smooth
    )


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)


def _body_rates(now: VehicleTruth, later: VehicleTruth) -> tuple[float, float, float]:
    """Roll, pitch and yaw rates in the body's axes, from the Euler angles' differences."""
    roll, pitch, yaw = (
        _wrapped(after - before) / _RATE_STEP_S
        for before, after in (
            (now.roll_rad, later.roll_rad),
            (now.pitch_rad, later.pitch_rad),
            (now.yaw_rad, later.yaw_rad),
        )
    )
    sr, cr, sp, cp = np.sin(now.roll_rad), np.cos(now.roll_rad), np.sin(now.pitch_rad), np.cos(now.pitch_rad)
    return float(roll - sp * yaw), float(cr * pitch + sr * cp * yaw), float(-sr * pitch + cr * cp * yaw)


def main(arguments: list[str] | None = None) -> int:
    """The process: 0 when its time is over or on SIGTERM, 78 for a wrong scenario."""
    parser = argparse.ArgumentParser(prog="python -m service.simulator.simulated_autopilot", description=__doc__)
    parser.add_argument("--scenario", required=True, help="a built-in name or a TOML file")
    parser.add_argument("--connect", required=True, metavar="HOST:PORT", help="where the service listens (udpin)")
    parser.add_argument("--start-monotonic-ns", required=True, type=int, help="CLOCK_MONOTONIC at the scenario's t = 0")
    parser.add_argument("--seed", type=int, help="of the errors and the jitter; the scenario's unless given")
    parser.add_argument("--duration", type=float, default=float("inf"), help="seconds, from t = 0")
    options = parser.parse_args(arguments)
    host, _, port = options.connect.rpartition(":")
    if not host or not port.isdecimal():
        parser.error(f"--connect is {options.connect!r}: it must be HOST:PORT")
    try:
        scenario = load_scenario(options.scenario)
    except ConfigError as error:
        print(shown(error), file=sys.stderr)
        return 78
    rng = np.random.default_rng(scenario.seed if options.seed is None else options.seed)
    utc_start_s = time.time() - (time.monotonic_ns() - options.start_monotonic_ns) * 1e-9
    stop, stopper = socket.socketpair()
    stopper.setblocking(False)
    with stop, stopper, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: stopper.send(b"s"))
        link.connect((host, int(port)))
        link.setblocking(False)
        autopilot = SimulatedAutopilot(scenario, rng, utc_start_s)
        serve(autopilot, [link], options.start_monotonic_ns, options.duration, stop)
    return 0


if __name__ == "__main__":
    sys.exit(main())
