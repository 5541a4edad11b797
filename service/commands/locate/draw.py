"""The answer as a picture: cameras, lines of sight, places with their ellipses. Only this needs matplotlib."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from distloc.batch.place import Located
from distloc.batch.sighting import Sighting
from service.commands.locate.shapes import outline
from service.commands.locate.words import name_of
from service.common.files import write_whole

_MOST_LINES = 300
_FAR_M = 30_000.0


def draw_map(path: Path, located: Located, sightings: Sequence[Sighting]) -> None:
    """Write a PNG; ModuleNotFoundError where there is no matplotlib."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    axes = figure.add_subplot()
    frame = located.frame
    cameras = np.array([frame.enu_from_geodetic(one.lat_deg, one.lon_deg, one.height_m) for one in sightings])
    used = {i for place in located.places for i in place.used}
    farthest = [place.bearing.range95_m[1] for place in located.places]
    reach_m = min(max([1.1 * one for one in farthest if np.isfinite(one)], default=_FAR_M), _FAR_M)
    for i in np.unique(np.linspace(0, len(sightings) - 1, min(len(sightings), _MOST_LINES)).astype(int)).tolist():
        end = cameras[i, :2] + reach_m * sightings[i].direction_enu[:2]
        east_km, north_km = np.array([cameras[i, :2], end]).T / 1e3
        axes.plot(east_km, north_km, "-" if i in used else ":", color="0.75", linewidth=0.6, zorder=1)
    for number, place in enumerate(located.places):
        colour = f"C{(number + 3) % 10}"
        for ring in outline(place, located, sightings[place.bearing.index]):
            corners = np.array([frame.enu_from_geodetic(lat, lon, frame.origin[2])[:2] for lon, lat in ring]) / 1e3
            axes.fill(*corners.T, facecolor=colour, edgecolor=colour, alpha=0.25, zorder=2)
        if place.position_enu_m is not None:
            at = place.position_enu_m[:2] / 1e3
            axes.plot(*at, "+", color=colour, markersize=10, zorder=4)
            axes.annotate(
                name_of(place), (float(at[0]), float(at[1])), xytext=(6, 6), textcoords="offset points", color=colour
            )
    axes.plot(*cameras[:, :2].T / 1e3, ".", color="k", markersize=4, zorder=3)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"km east of {frame.origin[0]:.5f}, {frame.origin[1]:.5f}")
    axes.set_ylabel("km north")
    axes.grid(alpha=0.3)
    axes.set_title("Places with their 95 % ellipses; dotted: not used")
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=110)
    write_whole(path, data.getvalue())
