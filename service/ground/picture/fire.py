"""One fire of the picture: a drone's last report of it, with its times on the ground's clock.

A drone numbers its fires anew with each flight, and where its service starts without its state: reports of one number
are of one fire where that was first seen at one time.
"""

from dataclasses import dataclass

from service.common.shown import shown
from service.ground.picture.clock import DroneClock, utc_s_from_text
from service.ground.picture.coordinates import PlaceTexts, place_texts
from service.ground.picture.drone import NAME_CHARACTERS, names
from service.ground.picture.marks import SAME_S, Mark
from service.ground.picture.views import FireView
from service.publish.exchange.fire import Outvoted, SharedFire, fire_uid
from service.publish.exchange.judged import judged
from service.publish.wire import Report

_LATE_S = 10.0  # a copy comes no later; what is older by more came after the drone's clock was set
_GREW_S = 3.0  # a fire gets older on the drone as it does here, up to the link's whims
_MOST_FIRSTS = 4
_SEEN = frozenset({"tentative", "confirmed"})
_IN_VIEW_S = 3.0  # since it was seen: reports and pictures come once a second
URGENCY = ("dismissed", "tentative", "coasting", "confirmed")


@dataclass(frozen=True, slots=True)
class Fire:
    """The last report, when that and the first one arrived, and its place as text.

    `firsts_s`: when it was first seen, by the drone's clock; another reading each time that this was set.
    """

    report: Report
    arrived_s: float
    vehicle: str
    place: PlaceTexts | None
    since_s: float
    firsts_s: tuple[float, ...]
    uid: str = ""  # as other programs know it, whatever its times become

    @property
    def number(self) -> str:
        """`VEHICLE/TARGET`."""
        return f"{self.vehicle}/{self.report.properties.target}"

    @property
    def first_s(self) -> float:
        """Since when it has been known, by the drone's clock: the same at each ground."""
        first_s = utc_s_from_text(self.report.properties.first_seen_utc)
        return self.since_s if first_s is None else first_s

    @property
    def seen_for_s(self) -> float:
        """From when it was first seen until it was last, by the drone's clock; 0 where it does not say."""
        said = self.report.properties
        first_s, last_s = (utc_s_from_text(one) for one in (said.first_seen_utc, said.last_seen_utc))
        return 0.0 if first_s is None or last_s is None else max(last_s - first_s, 0.0)

    def is_same(self, report: Report, arrived_s: float) -> bool:
        """Whether a report of its number is of this fire.

        It was first seen at the same time; or, where the drone's clock was set, it has been known for as much longer as
        went by here. A report that does not say since when is of it.
        """
        first_s = utc_s_from_text(report.properties.first_seen_utc)
        if first_s is None or not self.firsts_s or self._is_first(first_s):
            return True
        ours_s, theirs_s = _known_s(self.report), _known_s(report)
        if ours_s is None or theirs_s is None:
            return False
        return abs((theirs_s - ours_s) - (arrived_s - self.arrived_s)) <= _GREW_S

    def is_after(self, report: Report) -> bool:
        """Whether that is a late copy of an earlier word of this fire.

        By `seq` where it runs on, else by how long the fire had been known, which no set clock changes. Given up is
        said once, as the last word.
        """
        ours, theirs = self.report.properties, report.properties
        if theirs.state == "dismissed" or (theirs.epoch == ours.epoch and theirs.seq > ours.seq):
            return False
        ours_s, theirs_s = _known_s(self.report), _known_s(report)
        return ours_s is not None and theirs_s is not None and 0.0 < ours_s - theirs_s < _LATE_S

    def is_meant_by(self, mark: Mark, clock: DroneClock) -> bool:
        """Whether a mark of its number may be of this fire; one that does not say is of no fire that came after it."""
        if mark.first_drone_s is not None:
            return self._is_first(mark.first_drone_s)
        first_s = clock.live_s(self.firsts_s[-1] if self.firsts_s else None, self.since_s)
        return mark.time_s >= (self.since_s if first_s is None else first_s)

    def _is_first(self, first_s: float) -> bool:
        return any(abs(first_s - one) <= SAME_S for one in self.firsts_s)

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
        is_earlier: bool,
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
            advice=said.advice,
            degraded=names(said.degraded),
            told_s=told_s,
            seen_s=seen_s,
            first_s=first_s,
            mark=mark,
            may_be=may_be,
            preview_s=preview_s,
            first_drone_s=self.firsts_s[-1] if self.firsts_s else None,
            is_earlier=is_earlier,
        )

    def shared(
        self, clock: DroneClock, mark: Mark | None, is_earlier: bool, outvoted: Outvoted | None = None
    ) -> SharedFire:
        """As other programs are told."""
        said = self.report.properties
        told_s, seen_s = (
            clock.here_s(utc_s_from_text(text), self.arrived_s) for text in (said.time_utc, said.last_seen_utc)
        )
        return SharedFire(
            uid=self.uid,
            label=self.number,
            report=self.report,
            told_s=told_s or self.arrived_s,
            seen_s=seen_s,
            name="" if mark is None else mark.name,
            is_acknowledged=mark is not None and mark.is_acknowledged,
            is_no_fire=mark is not None and mark.verdict == "not_a_fire",
            is_earlier=is_earlier,
            outvoted=outvoted,
        )

    def age_s(self, clock: DroneClock, now_s: float) -> float:
        """Since it was seen, or since that was told where no time is."""
        seen_s = clock.here_s(utc_s_from_text(self.report.properties.last_seen_utc), self.arrived_s)
        return now_s - (self.arrived_s if seen_s is None else seen_s)

    def is_seen(self, clock: DroneClock, now_s: float) -> bool:
        """Whether the drone has it in view now, as far as is known."""
        seen_s = clock.live_s(utc_s_from_text(self.report.properties.last_seen_utc), self.arrived_s)
        return self.report.properties.state in _SEEN and seen_s is not None and now_s - seen_s <= _IN_VIEW_S


def fire_of(report: Report, before: Fire | None, arrived_s: float, vehicle: str) -> Fire:
    """The report's, as it is judged; the place is written anew only where it is another."""
    report = judged(report)
    since_s, firsts_s = (arrived_s, ()) if before is None else (before.since_s, before.firsts_s)
    first_s = utc_s_from_text(report.properties.first_seen_utc)
    if first_s is not None and not any(abs(first_s - one) <= SAME_S for one in firsts_s):
        firsts_s = (*firsts_s[1 - _MOST_FIRSTS :], first_s)
    uid = fire_uid(vehicle, report.properties.target, first_s) if before is None else before.uid
    return Fire(report, arrived_s, vehicle, _place(report, before), since_s, firsts_s, uid)


def _place(report: Report, before: Fire | None) -> PlaceTexts | None:
    geometry = report.geometry
    if geometry is None or len(geometry.coordinates) < 2:
        return None
    if before is not None and before.report.geometry == geometry:
        return before.place
    lon_deg, lat_deg = geometry.coordinates[:2]
    return place_texts(lat_deg, lon_deg)


def _known_s(report: Report) -> float | None:
    """For how long the fire had been known when that was said; without a first time only differences tell."""
    told_s, first_s = (utc_s_from_text(one) for one in (report.properties.time_utc, report.properties.first_seen_utc))
    return None if told_s is None else told_s - (first_s or 0.0)
