"""What goes out while flying, and when: reports, the vehicle, the status, MAVLink. No clock of its own, no sockets.

The links and zenoh are handed in; the app calls `publish` for each localised frame and `due` at 20 Hz.
"""

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from distloc.types import CameraPose
from service.autopilot.autopilot import Autopilot
from service.common.degraded import Degraded
from service.common.messages import Geodetic, LocatedTarget, MavFrame, VehicleState
from service.config.sections import Config
from service.localise.scenery import NoScenery, SceneryState
from service.localise.stage import Localised
from service.mavlink.framer import decode
from service.mavlink.link import Link
from service.mavlink.links import MavlinkLinks
from service.publish.exchange.drone import drone_from_report
from service.publish.exchange.fire import OwnFires
from service.publish.exchange.tak.switch import NullTak
from service.publish.footprint import Footprint
from service.publish.klv import make_klv
from service.publish.mavlink import MavlinkPublisher
from service.publish.overlay import annotated, encoded_jpeg
from service.publish.wire import StatusReport, encode, report_from_target, report_from_vehicle
from service.publish.zenoh import NullPublisher, ZenohPublisher

if TYPE_CHECKING:
    from service.publish.exchange.tak.publisher import TakPublisher

log = logging.getLogger(__name__)

_VEHICLE_NS = 500_000_000
_SECOND_NS = 1_000_000_000
_CURRENT_NS = 10_000_000_000  # without a frame for so long nobody is told of a fire as of now
_SETTLED_NS = 300_000_000  # a pose so old has had its later sample


class Outgoing:
    """Owns what is said over MAVLink; `links` and `zenoh` carry it."""

    def __init__(
        self,
        config: Config,
        autopilot: Autopilot,
        links: MavlinkLinks,
        zenoh: ZenohPublisher | NullPublisher,
        tak: "TakPublisher | NullTak",
    ) -> None:
        self._camera = config.camera.camera()
        self._footprint, self._fov_rad = Footprint(self._camera), self._camera.fov_rad
        self.mavlink = MavlinkPublisher(self._camera, config.mavlink.command_systems)
        self.klv = make_klv(config.klv, self._camera, config.vehicle)
        self._config, self._autopilot, self._links = config, autopilot, links
        self._zenoh, self._tak, self._own_fires = zenoh, tak, OwnFires(config.vehicle)
        self._vehicle: VehicleState | None = None
        self._scenery = NoScenery.state
        self._vehicle_due_ns = self._status_due_ns = 0
        self._located: list[LocatedTarget] = []
        self._located_ns = 0
        self._last_preview_ns = 0

    def publish(self, localised: Localised, targets: list[LocatedTarget], now_ns: int) -> None:
        """The reports of one frame."""
        for target in targets:
            report = report_from_target(target, self._config.vehicle)
            self._zenoh.publish_report(target.estimate.id, encode(report))
            self._tak.tell_fire(self._own_fires.shared(target, report))
        if targets:
            self._located, self._located_ns = targets, now_ns
            for data in self.mavlink.update(targets, now_ns):
                self._links.send_all(data, now_ns)
        if self._config.zenoh.preview and now_ns - self._last_preview_ns >= _SECOND_NS:
            self._last_preview_ns = now_ns
            picture = annotated(localised, self._camera)
            if picture is not None:
                self._zenoh.publish_preview(encoded_jpeg(picture))

    def answer(self, link: Link, command: MavFrame, now_ns: int) -> None:
        """Answer a command on the link that it came from; it tells of now, not of the last tick."""
        self.mavlink.see_vehicle(self._vehicle_state(now_ns))
        for reply in self.mavlink.handle(decode(command), now_ns):
            self._links.send(link, reply, now_ns)
        for system in self.mavlink.newly_refused():
            log.warning(
                "a command of system %d is refused, as mavlink.command_systems is %s: add it there if it is yours "
                "(MAVSDK's own id is 245)",
                system,
                list(self._config.mavlink.command_systems),
            )

    def due(self, now_ns: int, degraded: tuple[Degraded, ...], scenery: SceneryState) -> None:
        """Send the MAVLink messages and the vehicle's report that are due."""
        self._scenery = scenery
        if self._autopilot.target_system:
            self.mavlink.set_system(self._autopilot.target_system)
        is_vehicle_due = now_ns >= self._vehicle_due_ns
        if is_vehicle_due or self.mavlink.needs_vehicle(now_ns):
            self._vehicle = self._vehicle_state(now_ns)
        boot_ns = self._autopilot.boot_from_host(now_ns) or 0
        boot_ms = boot_ns // 1_000_000 & 0xFFFFFFFF
        for data in self.mavlink.due(now_ns, boot_ms, degraded, self._vehicle, scenery):
            self._links.send_all(data, now_ns)
        since_ns = now_ns - self._located_ns
        self.klv.due(self._located if since_ns < _CURRENT_NS else (), self._vehicle, now_ns)
        if self._links.has_adsb:
            for data in self.mavlink.adsb(self._located, now_ns, since_ns * 1e-9):
                self._links.send_adsb(data, now_ns)
        if is_vehicle_due and self._vehicle is not None:
            self._vehicle_due_ns = now_ns + _VEHICLE_NS
            report = report_from_vehicle(self._vehicle, self._config.vehicle)
            self._zenoh.publish_vehicle(encode(report))
            self._tak.tell_drone(drone_from_report(report, report.vehicle))

    def status_due(self, now_ns: int, status: Callable[[], StatusReport]) -> bool:
        """Publish the status once a second; whether it was due."""
        if now_ns < self._status_due_ns:
            return False
        self._status_due_ns = now_ns + _SECOND_NS
        self._zenoh.publish_status(encode(status()))
        return True

    def _vehicle_state(self, now_ns: int) -> VehicleState | None:
        """The camera's pose 0.3 s ago, where it has surely settled, and what it sees of flat ground as high as home.

        The attitude is as the scenery corrects it, so that a target's box is on the smoke; the heading is as reported.
        """
        stamp_ns = now_ns - _SETTLED_NS
        pose = self._autopilot.camera_pose(stamp_ns, now_ns)
        frame_enu = self._autopilot.frame_enu
        if not isinstance(pose, CameraPose) or frame_enu is None:
            return None
        pose = self._scenery.corrected(pose)
        time_utc_s, source = self._autopilot.utc_s(stamp_ns)
        place = Geodetic(*frame_enu.geodetic_from_enu(pose.position_enu_m))
        seen = self._footprint.seen(pose, frame_enu, self._autopilot.place.home_alt_msl_m)
        heading_deg = self._autopilot.heading_deg or 0.0
        undulation_m = self._autopilot.place.geoid_undulation_m
        return VehicleState(
            time_utc_s,
            source,
            place,
            heading_deg,
            pose,
            seen.corners,
            seen.centre,
            ellipsoidal_height_m=None if undulation_m is None else place.alt_msl_m + undulation_m,
            velocity_enu_mps=self._autopilot.velocity_enu_mps,
            fov_rad=self._fov_rad,
            R_ned_from_body=self._autopilot.craft_attitude(stamp_ns, now_ns),
        )
