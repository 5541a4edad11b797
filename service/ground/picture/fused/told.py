"""A fused fire as the page and as other programs are told of it. Free of I/O."""

import math
from collections.abc import Mapping

import msgspec

from service.ground.picture.fire import URGENCY, Fire
from service.ground.picture.fused.fusion import PREFIX, Joined
from service.ground.picture.marks import Mark, order
from service.ground.picture.views import FireView, FusedView, OutvotedView, TowerView
from service.publish.exchange.fire import MadeOf, SharedFire
from service.publish.exchange.tower import Sector, SharedTower
from service.publish.parts import AdviceReport, EllipseReport
from service.publish.wire import Point


def fused_view(fused_id: str, joined: Joined, members: list[FireView], may_be: list[str]) -> FireView:
    """As the page is told: the surest contributor's word with the place, times and marks of all."""
    one = joined.fire
    sure = [view for view in members if view.id in one.used]
    lead = next((view for view in members if PREFIX + view.id == fused_id), sure[0])
    best = min(sure, key=lambda view: (view.ellipse95.semi_major_m or math.inf, view.id))
    times = {name: [t for v in sure if (t := getattr(v, name)) is not None] for name in ("told_s", "seen_s", "first_s")}
    shown = [view for view in sure if view.preview_s is not None]
    return msgspec.structs.replace(
        best,
        id=fused_id,
        vehicle=lead.vehicle,
        target=lead.target,
        state=max((view.state for view in sure), key=URGENCY.index),
        lat_deg=joined.lat_deg,
        lon_deg=joined.lon_deg,
        place=joined.place,
        ellipse95=joined.ellipse95,
        region95=_with_smoke(joined.ellipse95, best),
        motion="fixed" if any(view.motion == "fixed" for view in sure) else best.motion,
        existence=max((view.existence or 0.0 for view in sure), default=None),
        observations=sum(view.observations for view in sure),
        degraded=sorted({name for view in sure for name in view.degraded}),
        told_s=max(times["told_s"], default=None),
        seen_s=max(times["seen_s"], default=None),
        first_s=min(times["first_s"], default=None),
        advice=_advice(joined, best),
        mark=_mark(members),
        may_be=may_be,
        preview_s=max((view.preview_s or 0.0 for view in shown), default=None),
        first_drone_s=None,
        is_earlier=False,
        fused="",
        outvoted_by="",
        made_of=FusedView(
            contributors=[view.id for view in sure],
            surest=best.id,
            undecided=list(one.undecided),
            outvoted=[
                OutvotedView(
                    id=word.name,
                    vehicle=word.name.partition("/")[0],
                    away_m=round(word.away_m, 1),
                    sigmas=round(word.sigmas, 1),
                )
                for word in one.outvoted
            ],
            towers=sorted({name.partition("@")[0] for name in one.bearings}),
            larger=round(one.larger, 2),
        ),
    )


def shared_tower(tower: TowerView, fires: Mapping[str, SharedFire]) -> SharedTower:
    """As other programs are told; `fires` by the picture's ids."""
    sectors = (
        Sector(one.azimuth_deg, one.opening_deg, one.told_s, fires[one.fire].uid if one.fire in fires else "")
        for one in tower.sectors
    )
    return SharedTower(tower.name, (tower.lat_deg, tower.lon_deg), tuple(sectors))


def _mark(members: list[FireView]) -> Mark | None:
    """The latest word; it is acknowledged where each that alone would give an alert is."""
    latest = max((view.mark for view in members if view.mark is not None), key=order, default=None)
    urgent = [view.mark for view in members if view.state == "confirmed"]
    if latest is None or not urgent:
        return latest
    is_acknowledged = all(mark is not None and mark.is_acknowledged for mark in urgent)
    return msgspec.structs.replace(latest, is_acknowledged=is_acknowledged)


def _with_smoke(ellipse: EllipseReport, best: FireView) -> EllipseReport:
    """The fused ellipse, larger by as much as the surest one's region of the smoke is than its ellipse."""
    inner, outer = best.ellipse95.semi_major_m, best.region95.semi_major_m
    more_m = max((outer or 0.0) - (inner or 0.0), 0.0)
    return EllipseReport(
        semi_major_m=round((ellipse.semi_major_m or 0.0) + more_m, 1),
        semi_minor_m=round((ellipse.semi_minor_m or 0.0) + more_m, 1),
        azimuth_deg=ellipse.azimuth_deg,
    )


def _advice(joined: Joined, best: FireView) -> AdviceReport | None:
    """The surest one's, where it makes the fire surer than all together have it."""
    advice, alone = best.advice, len(joined.fire.used) == 1 and not joined.fire.bearings
    if advice is None or alone:
        return advice
    half_m, ours_m = advice.half_length_m, joined.ellipse95.semi_major_m
    return advice if half_m is not None and ours_m is not None and half_m < ours_m else None


def fused_fire(view: FireView, joined: Joined, fires: Mapping[str, Fire], is_no_fire: bool) -> SharedFire:
    """As other programs are told: the report of the surest contributor, with what all together say of the fire."""
    assert view.made_of is not None
    one, surest = view.made_of, fires[view.made_of.surest]
    said, geometry = surest.report.properties, surest.report.geometry
    (ee, en), (_, nn) = joined.fire.covariance_m2.round(3).tolist()
    up = said.covariance_enu_m2[2][2] if [len(row) for row in said.covariance_enu_m2] == [3, 3, 3] else None
    height = [] if geometry is None else geometry.coordinates[2:3]
    report = msgspec.structs.replace(
        surest.report,
        geometry=Point(coordinates=[joined.lon_deg, joined.lat_deg, *height]),
        properties=msgspec.structs.replace(
            said,
            state=view.state,
            covariance_enu_m2=[[ee, en, None], [en, nn, None], [None, None, up]],
            ellipse95=view.ellipse95,
            region95=view.region95,
            ce90_m=joined.ce90_m,
            existence=view.existence,
            observations=view.observations,
            degraded=view.degraded,
            motion=view.motion,
            advice=view.advice,
        ),
    )

    def label(name: str) -> str:
        return fires[name].number if name in fires else name

    return SharedFire(
        uid=joined.uid,
        label=f"{view.vehicle}/{view.target}",
        report=report,
        told_s=view.told_s,
        seen_s=view.seen_s,
        name="" if view.mark is None else view.mark.name,
        is_acknowledged=view.mark is not None and view.mark.is_acknowledged,
        is_no_fire=is_no_fire,
        made_of=MadeOf(
            contributors=tuple(map(label, one.contributors)),
            undecided=tuple(map(label, one.undecided)),
            outvoted=tuple(label(word.id) for word in one.outvoted),
            towers=tuple(one.towers),
        ),
    )
