"""Fire fronts of the picture: fires in a row or a patch that several drones tell of. Free of I/O."""

from collections.abc import Mapping, Sequence, Set

import numpy as np

from distloc.batch.fusion.claims import FusedFire
from distloc.batch.fusion.fronts import fronts
from distloc.geometry.geodesy import LocalFrame
from service.ground.picture.fire import Fire
from service.ground.picture.fused.claims import Plane
from service.ground.picture.views import FrontView

_MOST_FRONTS = 32


def front_views(
    fused: Sequence[tuple[Plane, FusedFire]], ids: Sequence[str], fires: Mapping[str, Fire], joined: Set[str]
) -> list[FrontView]:
    """Of confirmed fires, fused or one drone's, that no others outvote; `ids` are those of `fused`, where `joined`."""
    outvoted = {word.name for _, one in fused for word in one.outvoted}
    sure = [
        (index, plane.degrees(one.position_en_m))
        for index, (plane, one) in enumerate(fused)
        if any(fires[name].report.properties.state in ("confirmed", "coasting") for name in one.used)
        and not outvoted.intersection(one.used)
    ]
    if len(sure) < 3:
        return []
    frame = LocalFrame(*sure[0][1], 0.0)
    places = np.array([frame.enu_from_geodetic(*place, 0.0)[:2] for _, place in sure])
    own = [fused[index][1] for index, _ in sure]
    found = fronts(
        places,
        np.array([one.covariance_m2 for one in own]),
        [frozenset(fires[name].vehicle for name in one.used) for one in own],
    )
    shown = [ids[index] if ids[index] in joined else fused[index][1].used[0] for index, _ in sure]
    return [
        FrontView(
            kind=one.kind,
            fires=[shown[i] for i in one.members],
            points=[(round(sure[i][1][1], 6), round(sure[i][1][0], 6)) for i in one.members],
        )
        for one in found[:_MOST_FRONTS]
    ]
