"""MISB ST 0601 out: a packet for each fire once a second, as a UDP datagram, for desks that show video with metadata.

`[klv]` turns it on. A fire that a packet's items cannot say, as an error of over 4095 m, is not sent: the largest value
that fits would say that it is surer than it is.
"""

import logging
import math
import socket
from collections.abc import Sequence

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_ENU_FROM_NED, R_FRD_FROM_CAM
from distloc.types import FloatArray, TargetState
from service.common import st0601
from service.common.messages import LocatedTarget, VehicleState
from service.common.st0601 import Tag
from service.config.endpoint import parse_endpoint
from service.config.sections import KlvConfig
from service.publish.parts import ce90_m, le90_m

_log = logging.getLogger(__name__)

MOST_TARGETS = 64
_SECOND_NS = 1_000_000_000
_SHOWN = (TargetState.CONFIRMED, TargetState.COASTING)


class KlvSender:
    """Sends from `open` to `close`; what the network does not take at once is dropped and counted."""

    def __init__(self, url: str, camera: Camera, name: str) -> None:
        endpoint = parse_endpoint(url)
        self._address = (endpoint.host, endpoint.port)
        self._camera, self._name = camera, name
        self._socket: socket.socket | None = None
        self._due_ns = 0
        self._counters = {"klv_sent": 0, "klv_dropped": 0, "klv_not_said": 0}

    @property
    def counters(self) -> dict[str, int]:
        """For the status message."""
        return dict(self._counters)

    def open(self) -> None:
        """Take a socket of the address' kind; nothing is asked of the network."""
        family = socket.AF_INET6 if ":" in self._address[0] else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def close(self) -> None:
        """Give the socket back."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def due(self, targets: Sequence[LocatedTarget], vehicle: VehicleState | None, now_ns: int) -> None:
        """Send what is due by now; call it often."""
        if self._socket is None or now_ns < self._due_ns:
            return
        shown = [one for one in targets if one.estimate.state in _SHOWN][:MOST_TARGETS]
        if not shown:
            return
        self._due_ns = now_ns + _SECOND_NS
        for target in shown:
            packet = fire_packet(target, vehicle, self._camera, self._name)
            self._counters["klv_not_said" if packet is None else self._send(packet)] += 1

    def _send(self, packet: bytes) -> str:
        assert self._socket is not None
        try:
            self._socket.sendto(packet, self._address)
        except OSError as error:
            if not self._counters["klv_dropped"]:
                _log.warning("KLV to %s:%d is not sent: %s", *self._address, error.strerror or error)
            return "klv_dropped"
        return "klv_sent"


class NoKlv:
    """Where nothing is sent."""

    counters: dict[str, int] = {}  # noqa: RUF012

    def open(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

    def due(self, targets: Sequence[LocatedTarget], vehicle: VehicleState | None, now_ns: int) -> None:
        """Nothing."""


def make_klv(config: KlvConfig, camera: Camera, name: str) -> KlvSender | NoKlv:
    """By the config, which has been checked."""
    return KlvSender(config.url, camera, name) if config.url else NoKlv()


def fire_packet(target: LocatedTarget, vehicle: VehicleState | None, camera: Camera, name: str) -> bytes | None:
    """One packet: where the fire is and how sure that is, and who saw it from where; None where that cannot be said.

    Heights are over the sea, angles degrees. The vehicle's items are left out where it is not known.
    """
    error_m, height_error_m = (of(target.estimate.covariance_enu_m2) for of in (ce90_m, le90_m))
    place = target.place
    time_utc_s = target.time_utc_s if vehicle is None else vehicle.time_utc_s
    if error_m is None or not 0.0 < time_utc_s < math.inf:
        return None
    told = {Tag.TARGET_LAT: place.lat_deg, Tag.TARGET_LON: place.lon_deg, Tag.CE90: error_m}
    if not all(st0601.holds(tag, value) for tag, value in told.items()):
        return None
    values: dict[int, float] = {Tag.TIME_US: round(time_utc_s * 1e6), Tag.VERSION: st0601.VERSION, **told}
    if height_error_m is not None and st0601.holds(Tag.LE90, height_error_m):
        values |= _held({Tag.TARGET_ELEVATION: place.alt_msl_m, Tag.LE90: height_error_m})
    if vehicle is not None:
        values |= _seen_from(vehicle, camera)
    return st0601.encoded(values, {Tag.MISSION: f"fire {target.estimate.id}", Tag.PLATFORM: name})


def _held(values: dict[int, float]) -> dict[int, float]:
    """All of these, or none: a height without its error would be taken for exact."""
    return values if all(st0601.holds(tag, value) for tag, value in values.items()) else {}


def _seen_from(vehicle: VehicleState, camera: Camera) -> dict[int, float]:
    """The vehicle's and the camera's items."""
    place, centre = vehicle.place, vehicle.image_centre
    values = _held({Tag.SENSOR_LAT: place.lat_deg, Tag.SENSOR_LON: place.lon_deg})
    values |= _held({Tag.SENSOR_ALT_MSL: place.alt_msl_m})
    if centre is not None:
        values |= _held({Tag.CENTRE_LAT: centre.lat_deg, Tag.CENTRE_LON: centre.lon_deg})
        values |= _held({Tag.CENTRE_ELEVATION: centre.alt_msl_m})
    for tag, size, focal in ((Tag.HFOV, camera.width, camera.fx), (Tag.VFOV, camera.height, camera.fy)):
        values[tag] = math.degrees(2.0 * math.atan2(size / 2.0, focal))
    if vehicle.R_ned_from_body is not None:
        values |= _attitude(vehicle.R_ned_from_body, vehicle.pose.R_cam_from_enu)
    return values


def _attitude(R_ned_from_body: FloatArray, R_cam_from_enu: FloatArray) -> dict[int, float]:
    """The platform's attitude, and the sensor's in it: azimuth, elevation, roll, as intrinsic yaw, pitch, roll."""
    R_ned_from_sensor = R_ENU_FROM_NED.T @ R_cam_from_enu.T @ R_FRD_FROM_CAM.T
    yaw_deg, pitch_deg, roll_deg = _angles_deg(R_ned_from_body)
    azimuth_deg, elevation_deg, turn_deg = _angles_deg(R_ned_from_body.T @ R_ned_from_sensor)
    values = {Tag.HEADING: yaw_deg % 360.0}
    values |= _held({Tag.PITCH: pitch_deg}) | _held({Tag.ROLL: roll_deg})
    values |= _held({Tag.PITCH_FULL: pitch_deg}) | _held({Tag.ROLL_FULL: roll_deg})
    values |= {Tag.RELATIVE_AZIMUTH: azimuth_deg % 360.0, Tag.RELATIVE_ROLL: turn_deg % 360.0}
    return values | {Tag.RELATIVE_ELEVATION: elevation_deg}


def _angles_deg(R: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch, roll of R_parent_from_child."""
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = math.asin(max(-1.0, min(1.0, -float(R[2, 0]))))
    return math.degrees(yaw), math.degrees(pitch), math.degrees(math.atan2(R[2, 1], R[2, 2]))
