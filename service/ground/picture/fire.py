"""One fire of the picture: a drone's last report of it, with its times on the ground's clock."""

from dataclasses import dataclass

from service.common.shown import shown
from service.ground.picture.clock import DroneClock, utc_s_from_text
from service.ground.picture.coordinates import PlaceTexts, place_texts
from service.ground.picture.drone import NAME_CHARACTERS, names
from service.ground.picture.marks import Mark
from service.ground.picture.views import FireView
from service.publish.wire import Report

_LATE_S = 10.0  # a copy comes no later; what is older by more came after the drone's clock was set
_SEEN = frozenset({"tentative", "confirmed"})
_IN_VIEW_S = 3.0  # since it was seen: reports and pictures come once a second
URGENCY = ("dismissed", "tentative", "coasting", "confirmed")


@dataclass(frozen=True, slots=True)
class Fire:
    """A report, when it arrived, and its place as text."""

    report: Report
    arrived_s: float
    vehicle: str
    place: PlaceTexts | None

    def is_newer_than(self, report: Report) -> bool:
        """Whether that is a late copy of an earlier word: by the drone's clock, unless that was set back."""
        ours_s, theirs_s = (utc_s_from_text(one.properties.time_utc) for one in (self.report, report))
        return ours_s is not None and theirs_s is not None and 0.0 < ours_s - theirs_s < _LATE_S

    @property
    def key(self) -> tuple[int, float]:
        """What has the least gives way first."""
        return URGENCY.index(self.report.properties.state), self.arrived_s

    def view(
        self,
        fire_id: str,
        clock: DroneClock,
        mark: Mark | None,
        may_be: list[str],
        preview_s: float | None,
    ) -> FireView:
        """As the page is told."""
        said, geometry = self.report.properties, self.report.geometry
        told_s, seen_s, first_s = (
            clock.here_s(utc_s_from_text(text), self.arrived_s)
            for text in (said.time_utc, said.last_seen_utc, said.first_seen_utc)
        )
        return FireView(
            id=fire_id,
            vehicle=self.vehicle,
            target=said.target,
            epoch=said.epoch,
            seq=said.seq,
            state=said.state,
            aim=shown(said.aim, most=NAME_CHARACTERS),
            lat_deg=None if geometry is None or self.place is None else geometry.coordinates[1],
            lon_deg=None if geometry is None or self.place is None else geometry.coordinates[0],
            place=self.place,
            altitude_msl_m=said.altitude_msl_m,
            ellipse95=said.ellipse95,
            region95=said.region95,
            vertical95_m=said.vertical95_m,
            extent_m=said.extent_m,
            plume=said.plume,
            range_m=said.range_m,
            range95_m=said.range95_m[:2],
            bearing_deg=said.bearing_deg,
            existence=said.existence,
            observations=said.observations,
            misses=said.misses,
            baseline_m=said.baseline_m,
            attitude=said.attitude,
            heading_sigma_deg=said.heading_sigma_deg,
            motion=said.motion,
            degraded=names(said.degraded),
            told_s=told_s,
            seen_s=seen_s,
            first_s=first_s,
            mark=mark,
            may_be=may_be,
            preview_s=preview_s,
        )

    def is_seen(self, clock: DroneClock, now_s: float) -> bool:
        """Whether the drone has it in view now, as far as is known."""
        seen_s = clock.here_s(utc_s_from_text(self.report.properties.last_seen_utc), self.arrived_s)
        return self.report.properties.state in _SEEN and seen_s is not None and now_s - seen_s <= _IN_VIEW_S


def fire_of(report: Report, before: Fire | None, arrived_s: float, vehicle: str) -> Fire:
    """The report's; the place is written anew only where it is another."""
    geometry = report.geometry
    if geometry is None or len(geometry.coordinates) < 2:
        return Fire(report, arrived_s, vehicle, None)
    if before is not None and before.report.geometry == geometry:
        return Fire(report, arrived_s, vehicle, before.place)
    lon_deg, lat_deg = geometry.coordinates[:2]
    return Fire(report, arrived_s, vehicle, place_texts(lat_deg, lon_deg))
