"""An imported flight as MAVLink with stamps, as a link to its autopilot would have been recorded. Free of I/O."""

import heapq
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import FloatArray
from service.recordings.importers.assumptions import EARTH_M
from service.recordings.importers.flight import (
    Attitudes,
    Estimates,
    Fixes,
    Gimbal,
    ImportedFlight,
    Positions,
    unknown,
)
from service.recordings.importers.output.resampling import STEP_S

SYSTEM, AUTOPILOT, COMPANION = 1, 1, 191
LEAD_S = 1.0  # of the time since boot before the first sample: 0 is "not stamped" to some messages
UNDATED_US = 86_400_000_000  # 1970-01-02: a log whose source has no date begins there
ASSUMED_FIX_S = 0.5
_HOME_S = 5.0
_BEFORE_MS = 10_000  # how long before the first pose a word still counts
_UNKNOWN_U16, _UNKNOWN_U8, _MOST_U32 = 2**16 - 1, 255, 2**32 - 2

_OF_FIXES = ("fix_type", "satellites", "h_acc_m", "v_acc_m")

Item = tuple[int, int, mavlink.MAVLink_message]  # ms since boot, component, message


@dataclass(frozen=True, slots=True)
class FlightClock:
    """From a flight's own times to the autopilot's, in milliseconds since boot, and to the log's stamps."""

    zero_s: float
    log_zero_us: int

    def boot_ms(self, time_s: FloatArray) -> list[int]:
        """Whole milliseconds since boot."""
        return [int(one) for one in np.rint((time_s - self.zero_s) * 1e3)]

    def stamps_us(self, time_s: FloatArray) -> list[int]:
        """Microseconds on the log's clock."""
        return [self.log_zero_us + int(one) for one in np.rint((time_s - self.zero_s) * 1e6)]


def clock_of(flight: ImportedFlight) -> FlightClock:
    """Boot is a second before all that the flight tells, frames included."""
    times = [one.time_s for one in (flight.positions, flight.craft, flight.frames) if one is not None]
    zero_s = min(float(one.min()) for one in times if len(one)) - LEAD_S
    log_zero_us = UNDATED_US if flight.epoch_s is None else max(0, round((flight.epoch_s + zero_s) * 1e6))
    return FlightClock(zero_s, log_zero_us)


def records(flight: ImportedFlight, clock: FlightClock, clock_sigma_s: float | None) -> Iterator[tuple[int, bytes]]:
    """(stamp in us, frame) in order of time; the flight is complete: place, heights, home and `craft` are known.

    `clock_sigma_s` is how sure it is that frames and poses are on one clock, one standard deviation, which TIMESYNC then
    says; None: nobody knows, and the replay keeps its doubt.
    """
    positions, craft = flight.positions, flight.craft
    assert positions is not None and craft is not None and flight.home is not None
    seconds = _seconds(clock, positions, craft)
    streams: list[Iterable[Item]] = [
        _each_second(flight, clock, seconds, clock_sigma_s),
        _fixes(flight.fixes or assumed_fixes(positions), positions, clock),
        _attitudes(craft, clock),
        _positions(positions, clock),
    ]
    if flight.estimates is not None:
        streams.append(_estimates(flight.estimates, clock))
    if flight.gimbal is not None:
        streams.append(_gimbal(flight.gimbal, clock))
    writers = {component: mavlink.MAVLink(None, SYSTEM, component) for component in (AUTOPILOT, COMPANION)}
    for boot_ms, component, message in heapq.merge(*streams, key=lambda item: item[0]):
        if not seconds.start - _BEFORE_MS <= boot_ms <= seconds.stop or boot_ms < 0:
            continue  # a fix or a gimbal's word from long before or after all poses
        writer = writers[component]
        frame = bytes(message.pack(writer))
        writer.seq = (writer.seq + 1) % 256
        yield clock.log_zero_us + boot_ms * 1000, frame


def assumed_fixes(positions: Positions) -> Fixes:
    """A fix wherever there is a place, for a source that says nothing of it."""
    kept = np.unique(np.floor(positions.time_s / ASSUMED_FIX_S), return_index=True)[1]
    count = len(kept)
    return Fixes(positions.time_s[kept], np.full(count, 3), np.full(count, _UNKNOWN_U8), unknown(count), unknown(count))


def _seconds(clock: FlightClock, positions: Positions, craft: Attitudes) -> range:
    last_s = max(positions.time_s[-1], craft.time_s[-1])
    first_s = min(positions.time_s[0], craft.time_s[0])
    first_ms, last_ms = clock.boot_ms(np.array([first_s - 0.5 * LEAD_S, last_s + LEAD_S]))
    return range(first_ms, last_ms, 1000)


def _each_second(
    flight: ImportedFlight, clock: FlightClock, seconds: range, clock_sigma_s: float | None
) -> Iterator[Item]:
    """Heartbeat, time and clock's tie; home now and then."""
    assert flight.home is not None
    lat, lon, alt_mm = round(flight.home[0] * 1e7), round(flight.home[1] * 1e7), round(flight.home[2] * 1e3)
    for number, boot_ms in enumerate(seconds):
        stamp_us = clock.log_zero_us + boot_ms * 1000
        yield boot_ms, AUTOPILOT, mavlink.MAVLink_heartbeat_message(0, mavlink.MAV_AUTOPILOT_GENERIC, 0, 0, 4, 3)
        if flight.epoch_s is not None:
            yield boot_ms, AUTOPILOT, mavlink.MAVLink_system_time_message(stamp_us, boot_ms)
        if clock_sigma_s is not None:
            yield from _synced(boot_ms, stamp_us * 1000, round(clock_sigma_s * 1e9))
        if number % _HOME_S == 0:
            yield (
                boot_ms,
                AUTOPILOT,
                mavlink.MAVLink_home_position_message(lat, lon, alt_mm, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0),
            )


def _synced(boot_ms: int, stamp_ns: int, sigma_ns: int) -> Iterator[Item]:
    """Requests and replies whose offsets have the true one as their median and two standard deviations as their width."""
    for number, beside_ns in enumerate((0, sigma_ns, -sigma_ns) if sigma_ns else (0,)):
        yield boot_ms, COMPANION, mavlink.MAVLink_timesync_message(0, stamp_ns + number)
        yield boot_ms, AUTOPILOT, mavlink.MAVLink_timesync_message(boot_ms * 1_000_000 + beside_ns, stamp_ns + number)


def _attitudes(attitudes: Attitudes, clock: FlightClock) -> Iterator[Item]:
    rows = zip(clock.boot_ms(attitudes.time_s), attitudes.q_ned_from_body, attitudes.rate_rps, strict=True)
    for boot_ms, q, rate in rows:
        yield boot_ms, AUTOPILOT, mavlink.MAVLink_attitude_quaternion_message(boot_ms, *q.tolist(), *rate.tolist())


def _positions(positions: Positions, clock: FlightClock) -> Iterator[Item]:
    """The first one twice, the earlier on the way to it: the replay believes a place once two agree."""
    positions = _with_lead(positions)
    for i, boot_ms in enumerate(clock.boot_ms(positions.time_s)):
        message = mavlink.MAVLink_global_position_int_message(
            boot_ms,
            round(positions.lat_deg[i] * 1e7),
            round(positions.lon_deg[i] * 1e7),
            round(positions.alt_msl_m[i] * 1e3),
            round(positions.above_home_m[i] * 1e3),
            *(int(np.clip(round(one * 1e2), -32768, 32767)) for one in positions.velocity_ned_mps[i]),
            _UNKNOWN_U16,
        )
        yield boot_ms, AUTOPILOT, message


def _with_lead(positions: Positions) -> Positions:
    columns = {name: getattr(positions, name) for name in Positions.__dataclass_fields__}
    columns = {name: np.concatenate([column[:1], column]) for name, column in columns.items()}
    north_mps, east_mps, down_mps = positions.velocity_ned_mps[0]
    metres_a_degree = math.radians(1.0) * EARTH_M
    columns["time_s"][0] -= STEP_S
    columns["lat_deg"][0] -= STEP_S * north_mps / metres_a_degree
    columns["lon_deg"][0] -= (
        STEP_S * east_mps / metres_a_degree / max(0.01, math.cos(math.radians(positions.lat_deg[0])))
    )
    for name in ("alt_msl_m", "above_home_m"):
        columns[name][0] += STEP_S * down_mps
    return Positions(**columns)


def _fixes(fixes: Fixes, positions: Positions, clock: FlightClock) -> Iterator[Item]:
    """The receiver's word; it also has both heights, which tell the geoid's. The first one comes before all places."""
    first = Fixes(**{name: getattr(fixes, name)[:1] for name in Fixes.__dataclass_fields__})
    lead_s = max(0.0, float(fixes.time_s[0] - positions.time_s[0])) + 2.0 * STEP_S
    fixes = Fixes(
        np.concatenate([first.time_s - lead_s, fixes.time_s]),
        *(np.concatenate([getattr(first, name), getattr(fixes, name)]) for name in _OF_FIXES),
    )
    nearest = np.clip(np.searchsorted(positions.time_s, fixes.time_s), 0, len(positions.time_s) - 1)
    for i, boot_ms in enumerate(clock.boot_ms(fixes.time_s)):
        at = int(nearest[i])
        ellipsoid_m = positions.alt_ellipsoid_m[at]
        message = mavlink.MAVLink_gps_raw_int_message(
            boot_ms * 1000,
            int(fixes.fix_type[i]),
            round(positions.lat_deg[at] * 1e7),
            round(positions.lon_deg[at] * 1e7),
            round(positions.alt_msl_m[at] * 1e3),
            _UNKNOWN_U16,
            _UNKNOWN_U16,
            _UNKNOWN_U16,
            _UNKNOWN_U16,
            int(fixes.satellites[i]),
            round(ellipsoid_m * 1e3) if math.isfinite(ellipsoid_m) else 0,
            _millimetres(fixes.h_acc_m[i]),
            _millimetres(fixes.v_acc_m[i]),
        )
        yield max(boot_ms, 0), AUTOPILOT, message


def _estimates(estimates: Estimates, clock: FlightClock) -> Iterator[Item]:
    columns = (
        estimates.velocity_ratio,
        estimates.position_ratio,
        estimates.height_ratio,
        estimates.compass_ratio,
    )
    for i, boot_ms in enumerate(clock.boot_ms(estimates.time_s)):
        ratios = [float(one[i]) for one in columns]
        yield boot_ms, AUTOPILOT, mavlink.MAVLink_ekf_status_report_message(int(estimates.flags[i]), *ratios, math.nan)


def _gimbal(gimbal: Gimbal, clock: FlightClock) -> Iterator[Item]:
    """Whether it holds its yaw no source says: "at its limit" is the protocol's word under which that is not told."""
    is_earth = gimbal.yaw_from == "earth"
    flags = (
        mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME if is_earth else mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
    )
    failure = mavlink.GIMBAL_DEVICE_ERROR_FLAGS_AT_YAW_LIMIT
    rows = zip(clock.boot_ms(gimbal.attitudes.time_s), gimbal.attitudes.q_ned_from_body, strict=True)
    for boot_ms, q in rows:
        if boot_ms > 0:
            yield (
                boot_ms,
                AUTOPILOT,
                mavlink.MAVLink_gimbal_device_attitude_status_message(
                    0, 0, boot_ms, flags, q.tolist(), math.nan, math.nan, math.nan, failure, math.nan, math.nan, 1
                ),
            )


def _millimetres(metres: float) -> int:
    """0 where not told."""
    return min(_MOST_U32, max(1, round(metres * 1e3))) if math.isfinite(metres) else 0
