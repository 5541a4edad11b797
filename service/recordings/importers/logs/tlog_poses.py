"""Reads a MAVLink telemetry log as the service itself would hear it: its vehicle's poses, on the log's clock."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import FloatArray
from service.autopilot.boot_clock import EARLIEST_UTC_S, LATEST_UTC_S, BootClock
from service.autopilot.intake.intake import Intake
from service.autopilot.message_ids import (
    ATTITUDE,
    ATTITUDE_QUATERNION,
    EKF_STATUS_REPORT,
    ESTIMATOR_STATUS,
    GIMBAL_DEVICE_ATTITUDE_STATUS,
    GLOBAL_POSITION_INT,
    GPS_RAW_INT,
    HEARTBEAT,
    HOME_POSITION,
    SYSTEM_TIME,
    TIMESYNC,
)
from service.autopilot.payload.gimbal_attitude import attitude_of as gimbal_attitude_of
from service.autopilot.poses import attitude_of
from service.autopilot.timesync import SETTLED_SAMPLES, Timesync
from service.mavlink.framer import Framer
from service.recordings.importers.flight import (
    Attitudes,
    Estimates,
    Fixes,
    Gimbal,
    Given,
    ImportedFlight,
    ImportRefusedError,
    IntArray,
    Positions,
    Remarks,
)
from service.recordings.importers.rows import Rows, attitudes_of, count, fixes_of, most_rising, positions_of
from service.recordings.recording import RecordingError
from service.recordings.tlog import TlogReader

_WINDOW_S = 10.0  # in which the least delayed message tells the two clocks' offset
_UNKNOWN_U32, _UNKNOWN_U8 = 2**32 - 1, 255
_EKF_UNINITIALISED, _EKF_GLITCHING = 1024, 32768
_SAME_BITS, _GLITCH, _ACCELEROMETER = 0x3FF, 1 << 10, 1 << 11  # of ESTIMATOR_STATUS

_WIDTHS = {
    **{"attitudes": 9, "positions": 9, "fixes": 6, "estimates": 6, "gimbal": 7},
    **{"utc_minus_log": 1, "offsets": 3, "synced": 3},
}


@dataclass(slots=True)
class _Heard:
    """Rows of each kind: of poses the boot's number and seconds since it, of the rest seconds on the log's clock."""

    path: Path
    home: tuple[float, float, float] | None = None
    invalid: int = 0
    attitudes: Rows = field(init=False)
    positions: Rows = field(init=False)
    fixes: Rows = field(init=False)
    estimates: Rows = field(init=False)
    gimbal: Rows = field(init=False)
    utc_minus_log: Rows = field(init=False)
    offsets: Rows = field(init=False)  # boot, seconds since it, log's clock less that
    synced: Rows = field(init=False)  # the same by TIMESYNC, where somebody asked for it

    def __post_init__(self) -> None:
        for name, width in _WIDTHS.items():
            setattr(self, name, Rows(width, f"{self.path}: {name}"))


class _Listener:
    """Takes the log's frames in order."""

    def __init__(self, path: Path) -> None:
        self.heard = _Heard(path)
        self.boot, self._path, self._offset_s = 0, path, 0.0
        self._clock, self._sync = BootClock(), Timesync()
        self._takers: dict[int, Callable[[Any, float], None]] = {
            HEARTBEAT: lambda message, now_s: None,
            ATTITUDE: self._attitude,
            ATTITUDE_QUATERNION: self._attitude,
            GLOBAL_POSITION_INT: self._position,
            GPS_RAW_INT: self._fix,
            EKF_STATUS_REPORT: self._ekf,
            ESTIMATOR_STATUS: self._estimator,
            GIMBAL_DEVICE_ATTITUDE_STATUS: self._gimbal,
            HOME_POSITION: self._home,
            SYSTEM_TIME: self._utc,
            TIMESYNC: self._reply,
        }
        self.intake = Intake(
            0, self._takers, self._clear, lambda message, now_ns: self._sync.request_sent(message.ts1, now_ns)
        )

    def read(self, reader: TlogReader) -> None:
        """The whole log."""
        framer = Framer()
        for stamp_us, raw in reader:
            for frame in framer.feed(raw):
                message = self.intake.take(frame, stamp_us * 1000)
                if message is not None:
                    if frame.message_id == HEARTBEAT:
                        self.intake.heartbeat_ns = stamp_us * 1000
                    self._takers[frame.message_id](message, stamp_us * 1e-6)

    def _clear(self) -> None:
        self.heard = _Heard(self._path)
        self._clock.reset()
        self._sync.reset()

    def _boot_s(self, boot_ms: int, now_s: float) -> float | None:
        boot_ns = self._clock.update(boot_ms, round(now_s * 1e9))
        if self._clock.take_reboot():
            self.boot += 1
            self._sync.reset()
        if boot_ns is None:
            return None
        self._offset_s = now_s - boot_ns * 1e-9
        self.heard.offsets.add(self.boot, boot_ns * 1e-9, self._offset_s)
        return boot_ns * 1e-9

    def _attitude(self, message: Any, now_s: float) -> None:
        q, boot_s = attitude_of(message), self._boot_s(message.time_boot_ms, now_s)
        if q is None or boot_s is None:
            self.heard.invalid += 1
            return
        rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
        self.heard.attitudes.add(self.boot, boot_s, *q.tolist(), *rates)

    def _position(self, message: Any, now_s: float) -> None:
        boot_s = self._boot_s(message.time_boot_ms, now_s)
        if boot_s is None:
            return
        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3, message.relative_alt * 1e-3)
        self.heard.positions.add(self.boot, boot_s, *place, message.vx * 1e-2, message.vy * 1e-2, message.vz * 1e-2)

    def _fix(self, message: Any, now_s: float) -> None:
        h_acc_m, v_acc_m = (
            one * 1e-3 if 0 < one < _UNKNOWN_U32 else np.nan
            for one in (getattr(message, "h_acc", 0), getattr(message, "v_acc", 0))
        )
        ellipsoid_mm = getattr(message, "alt_ellipsoid", 0)
        undulation_m = (ellipsoid_mm - message.alt) * 1e-3 if ellipsoid_mm and message.fix_type >= 3 else np.nan
        self.heard.fixes.add(now_s, message.fix_type, message.satellites_visible, h_acc_m, v_acc_m, undulation_m)

    def _ekf(self, message: Any, now_s: float) -> None:
        ratios = (
            *(message.velocity_variance, message.pos_horiz_variance),
            *(message.pos_vert_variance, message.compass_variance),
        )
        self.heard.estimates.add(now_s, message.flags, *ratios)

    def _estimator(self, message: Any, now_s: float) -> None:
        status = int(message.flags)
        flags = status & _SAME_BITS | (_EKF_GLITCHING if status & _GLITCH else 0)
        flags |= _EKF_UNINITIALISED if status & _ACCELEROMETER else 0
        ratios = (message.vel_ratio, message.pos_horiz_ratio, message.pos_vert_ratio, message.mag_ratio)
        self.heard.estimates.add(now_s, flags, *ratios)

    def _gimbal(self, message: Any, now_s: float) -> None:
        attitude = gimbal_attitude_of(message, False)
        if isinstance(attitude, str):
            self.heard.invalid += 1
            return
        is_ours = message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
        boot_ns = self._clock.peek(message.time_boot_ms, round(now_s * 1e9)) if is_ours else None
        boot_s = self._last_s(now_s) if boot_ns is None else boot_ns * 1e-9
        if boot_s is not None:
            self.heard.gimbal.add(self.boot, boot_s, *attitude.q.tolist(), attitude.is_from_north)

    def _last_s(self, now_s: float) -> float | None:
        """Since boot by the log's clock, of what is stamped by a clock of its own."""
        return now_s - self._offset_s if len(self.heard.offsets) else None

    def _reply(self, message: Any, now_s: float) -> None:
        now_ns = round(now_s * 1e9)
        if message.tc1 and self._sync.reply(message.ts1, message.tc1, now_ns) and not self._sync.take_jump():
            offset_ns = self._sync.offset_ns()
            if offset_ns is not None:
                self.heard.synced.add(self.boot, (now_ns - offset_ns) * 1e-9, offset_ns * 1e-9)

    def _home(self, message: Any, now_s: float) -> None:
        self.heard.home = (message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)

    def _utc(self, message: Any, now_s: float) -> None:
        utc_s = message.time_unix_usec * 1e-6
        if EARLIEST_UTC_S < utc_s < LATEST_UTC_S:
            self.heard.utc_minus_log.add(utc_s - now_s)


def read_tlog_poses(path: Path, given: Given) -> ImportedFlight:
    """What the log tells of the vehicle that the service would follow. ImportRefusedError where that is no pose."""
    reader, listener = TlogReader(path), _Listener(path)
    try:
        listener.read(reader)
    except (OSError, RecordingError) as error:
        raise ImportRefusedError(f"{path}: cannot be read: {error}") from error
    heard, remarks = listener.heard, Remarks()
    if not reader.frames:
        raise ImportRefusedError(f"{path}: holds no MAVLink frame with a stamp: is it a telemetry log?")
    if not len(heard.attitudes) and not len(heard.positions):
        raise ImportRefusedError(f"{path}: {reader.frames} MAVLink frames, and no pose of an autopilot among them")
    epoch_s = float(np.floor(heard.offsets.table()[:, 1:].sum(axis=1).min()))
    to_log = _LogClock(heard.offsets.table(), heard.synced.table())
    count(remarks, "attitude: no rotation, or of a doubtful clock", heard.invalid)
    count(remarks, "record: its stamp stands alone", reader.wild)
    remarks.found.append(f"system {listener.intake.followed.system}, {reader.frames} MAVLink frames")
    if len(heard.utc_minus_log):
        remarks.found.append(
            f"the log's clock is {-float(np.median(heard.utc_minus_log.table())):+.2f} s from GPS time"
        )
    return ImportedFlight(
        path.name,
        epoch_s,
        positions=_positions(heard, to_log, epoch_s, remarks),
        craft=_attitudes(heard.attitudes, to_log, epoch_s, remarks),
        gimbal=_gimbal(heard, to_log, epoch_s, remarks),
        fixes=_fixes(heard, epoch_s, remarks),
        estimates=_estimates(heard, epoch_s),
        home=heard.home,
        remarks=remarks,
    )


class _LogClock:
    """The log's clock of a time since boot, boot by boot: by TIMESYNC, else by the least delayed messages around it."""

    def __init__(self, heard: FloatArray, told: FloatArray) -> None:
        self._knots: dict[int, tuple[FloatArray, FloatArray]] = {}
        for boot in np.unique(heard[:, 0]):
            _, since_s, offset_s = told[told[:, 0] == boot].T
            if len(since_s) < SETTLED_SAMPLES:
                _, since_s, offset_s = heard[heard[:, 0] == boot].T
                windows = np.floor(since_s / _WINDOW_S)
                order = np.lexsort((offset_s, windows))
                least = order[np.unique(windows[order], return_index=True)[1]]
                since_s, offset_s = since_s[least], offset_s[least]
            kept = most_rising(since_s)
            self._knots[int(boot)] = (since_s[kept], offset_s[kept])

    def time_s(self, boots: FloatArray, since_s: FloatArray) -> FloatArray:
        """(N,) of times since the boots (N,)."""
        out = np.full(len(since_s), np.nan)
        for boot, (knots_s, offsets_s) in self._knots.items():
            is_of = boots == boot
            out[is_of] = since_s[is_of] + np.interp(since_s[is_of], knots_s, offsets_s)
        return out


def _attitudes(rows: Rows, to_log: _LogClock, epoch_s: float, remarks: Remarks) -> Attitudes | None:
    if not len(rows):
        return None
    table = rows.table()
    return attitudes_of(to_log.time_s(table[:, 0], table[:, 1]) - epoch_s, table[:, 2:6], remarks, table[:, 6:9])


def _positions(heard: _Heard, to_log: _LogClock, epoch_s: float, remarks: Remarks) -> Positions | None:
    if not len(heard.positions):
        return None
    table = heard.positions.table()
    undulations_m = heard.fixes.table()[:, 5]
    undulations_m = undulations_m[np.isfinite(undulations_m)]
    undulation_m = float(np.median(undulations_m)) if len(undulations_m) else np.nan
    return positions_of(
        to_log.time_s(table[:, 0], table[:, 1]) - epoch_s,
        table[:, 2],
        table[:, 3],
        remarks,
        alt_msl_m=table[:, 4],
        alt_ellipsoid_m=table[:, 4] + undulation_m,
        above_home_m=table[:, 5],
        velocity_ned_mps=table[:, 6:9],
    )


def _fixes(heard: _Heard, epoch_s: float, remarks: Remarks) -> Fixes | None:
    if not len(heard.fixes):
        return None
    table = heard.fixes.table()
    return fixes_of(
        table[:, 0] - epoch_s, table[:, 1], remarks, satellites=table[:, 2], h_acc_m=table[:, 3], v_acc_m=table[:, 4]
    )


def _estimates(heard: _Heard, epoch_s: float) -> Estimates | None:
    if not len(heard.estimates):
        return None
    table = heard.estimates.table()
    table = table[most_rising(table[:, 0])]
    flags: IntArray = table[:, 1].astype(np.int64)
    return Estimates(table[:, 0] - epoch_s, flags, table[:, 2], table[:, 3], table[:, 4], table[:, 5])


def _gimbal(heard: _Heard, to_log: _LogClock, epoch_s: float, remarks: Remarks) -> Gimbal | None:
    if not len(heard.gimbal):
        return None
    table = heard.gimbal.table()
    is_earth = table[:, 6] > 0.0
    if 0 < is_earth.mean() < 1:
        remarks.lacks.append("the gimbal's attitude: the frame of its yaw changes in flight")
        return None
    times_s = to_log.time_s(table[:, 0], table[:, 1]) - epoch_s
    attitudes = attitudes_of(times_s, table[:, 2:6], remarks, name="gimbal")
    return None if attitudes is None else Gimbal(attitudes, "earth" if is_earth.all() else "vehicle")
