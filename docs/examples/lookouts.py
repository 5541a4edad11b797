"""Three lookouts and a drone see two fires: where are they, and how sure is that? Draws a map.

Run it with `pip install '.[study]'`: python docs/examples/lookouts.py [PICTURE.png]
"""

import math
import sys
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, Wedge

import distloc

HOME = distloc.LocalFrame(47.0, 8.0, 500.0)  # positions below are east, north, up of it, in metres
FIRES = {"north": np.array([1200.0, 6500.0, 120.0]), "south": np.array([3600.0, -1500.0, 60.0])}
COLOURS = {"north": "#c8402f", "south": "#d98516"}
INSETS = {"north": (0.03, 0.72, 0.25, 0.25), "south": (0.73, 0.06, 0.25, 0.25)}
SMALL_M = 200.0
INK, PALE = "#26323a", "#9aa7ad"


@dataclass(frozen=True)
class Watcher:
    """Who looks: `way` (N, 3) are its places, `wrong_deg` what its compass errs by, which nobody tells `locate`."""

    name: str
    way: np.ndarray
    wrong_deg: float
    errors: distloc.PoseErrors


def errors(heading_deg: float, lasts_s: float) -> distloc.PoseErrors:
    """One standard deviation of what the attitude errs by: 0.3 degrees of tilt, 0.1 from picture to picture."""
    return distloc.PoseErrors(math.radians(heading_deg), math.radians(0.3), math.radians(0.1), 1.0, lasts_s)


LOOKOUTS = [
    Watcher("hill", np.array([[-9500.0, 1800.0, 620.0]]).repeat(6, axis=0), 2.1, errors(2.0, 1e7)),
    Watcher("mast", np.array([[8800.0, 7200.0, 240.0]]).repeat(6, axis=0), -1.3, errors(2.0, 1e7)),
    Watcher("ridge", np.array([[-2500.0, -8600.0, 710.0]]).repeat(6, axis=0), 1.6, errors(2.0, 1e7)),
]
DRONE = Watcher("drone", np.linspace([-800.0, 900.0, 150.0], [2600.0, 3300.0, 150.0], 25), -1.8, errors(2.0, 600.0))


def sightings_of(watcher: Watcher, rng: np.random.Generator) -> list[distloc.Sighting]:
    """What it reports of both fires: the true direction, turned by its compass, and marked a little beside."""
    found = []
    for i, place in enumerate(watcher.way):
        lat_deg, lon_deg, height_m = HOME.geodetic_from_enu(place)
        for fire in FIRES.values():
            east, north, up = fire - place
            azimuth = math.atan2(east, north) + math.radians(watcher.wrong_deg) + 1.5e-3 * rng.standard_normal()
            elevation = math.atan2(up, math.hypot(east, north)) + 1.5e-3 * rng.standard_normal()
            found.append(
                distloc.Sighting(
                    lat_deg,
                    lon_deg,
                    height_m,
                    distloc.direction_from_azimuth(azimuth, elevation),
                    sigma_rad=(1.5e-3, 1.5e-3),
                    platform=watcher.name,
                    stamp_s=20.0 * i,
                    errors=watcher.errors,
                )
            )
    return found


def enlarged(axes: Axes, name: str, middle_km: tuple[float, float], shape: dict[str, float]) -> None:
    """The same place fifty times larger, in a corner."""
    inset = axes.inset_axes(INSETS[name])
    inset.add_patch(Ellipse(middle_km, **shape, fc=COLOURS[name], ec="none", alpha=0.35))
    inset.add_patch(Ellipse(middle_km, **shape, fc="none", ec=COLOURS[name], lw=2.0))
    inset.plot(*FIRES[name][:2] / 1e3, "*", color="white", mec=INK, mew=1.1, ms=13)
    half_km = 0.05
    inset.set(
        aspect="equal",
        xlim=(middle_km[0] - half_km, middle_km[0] + half_km),
        ylim=(middle_km[1] - half_km, middle_km[1] + half_km),
        xticks=[],
        yticks=[],
    )
    inset.set_xlabel("100 m", color=INK, fontsize=8, labelpad=2)
    axes.indicate_inset_zoom(inset, edgecolor=PALE)


def map_of(axes: Axes, title: str, watchers: list[Watcher], sightings: list[distloc.Sighting]) -> None:
    """Lines of sight as far as the compass may turn them, the places with their 95 % ellipses, and the truth."""
    located = distloc.locate(sightings)
    for watcher in watchers:
        east_km, north_km, _ = watcher.way.T / 1e3
        for name, fire in FIRES.items():
            east, north, _ = fire - watcher.way[0]
            azimuth = math.degrees(math.atan2(north, east)) - watcher.wrong_deg
            if watcher.name != "drone":
                spread = 2.0 * math.degrees(watcher.errors.heading_bias_rad)
                beam = (azimuth - spread, azimuth + spread)
                axes.add_patch(Wedge((east_km[0], north_km[0]), 24.0, *beam, color=COLOURS[name], alpha=0.07, lw=0))
        axes.plot(east_km, north_km, color=INK, lw=2.2, solid_capstyle="round", zorder=4)
        axes.plot(east_km[-1], north_km[-1], "^" if watcher.name != "drone" else "o", color=INK, ms=7, zorder=5)
        axes.annotate(watcher.name, (east_km[-1], north_km[-1]), (7, -12), textcoords="offset points", color=INK)
    for place in located.places:
        middle_m = HOME.enu_from_geodetic(place.lat_deg, place.lon_deg, place.height_m)
        name = min(FIRES, key=lambda one: float(np.hypot(*(FIRES[one] - middle_m)[:2])))
        inside = distloc.ellipse_holds(place.ellipse95, (FIRES[name] - middle_m)[:2])
        major_m, minor_m = place.ellipse95.semi_major_m, place.ellipse95.semi_minor_m
        azimuth_deg = math.degrees(place.ellipse95.azimuth_rad)
        shape = {"width": 2e-3 * major_m, "height": 2e-3 * minor_m, "angle": 90.0 - azimuth_deg}
        middle_km = tuple(middle_m[:2] / 1e3)
        axes.add_patch(Ellipse(middle_km, **shape, fc=COLOURS[name], ec="none", alpha=0.35, zorder=3))
        axes.add_patch(Ellipse(middle_km, **shape, fc="none", ec=COLOURS[name], lw=2.0, zorder=6))
        if major_m < SMALL_M:
            enlarged(axes, name, middle_km, shape)
        axes.annotate(
            f"{major_m:,.0f} m x {minor_m:,.0f} m",
            middle_km,
            (14, 20),
            textcoords="offset points",
            color=COLOURS[name],
            weight="bold",
            zorder=8,
        )
        off_m = math.dist(middle_m[:2], FIRES[name][:2])
        print(
            f"{title}: the {name} fire is at {place.lat_deg:.4f}, {place.lon_deg:.4f}, within {major_m:.0f} m x "
            f"{minor_m:.0f} m; {off_m:.0f} m off, {'inside' if inside else 'OUTSIDE'}"
        )
    for fire in FIRES.values():
        axes.plot(*fire[:2] / 1e3, "*", color="white", mec=INK, mew=1.1, ms=13, zorder=7)
    axes.set(title=title, aspect="equal", xlim=(-11.0, 11.0), ylim=(-10.0, 10.0), xlabel="km east")
    axes.grid(color=PALE, lw=0.5, alpha=0.4)
    axes.spines[["top", "right", "left", "bottom"]].set_visible(False)
    axes.tick_params(length=0, colors=INK)


def main(picture: str) -> None:
    """Locate by the lookouts alone, then with the drone, and draw both."""
    rng = np.random.default_rng(3)
    by_lookouts = [one for watcher in LOOKOUTS for one in sightings_of(watcher, rng)]
    by_drone = sightings_of(DRONE, rng)
    figure, (left, right) = plt.subplots(1, 2, figsize=(12.0, 5.9), sharey=True, layout="constrained")
    map_of(left, "Three lookouts", LOOKOUTS, by_lookouts)
    map_of(right, "With a drone's two kilometres", [*LOOKOUTS, DRONE], by_lookouts + by_drone)
    left.set_ylabel("km north")
    figure.suptitle(
        "Two fires with their 95 % ellipses; stars: where they are. Wedges: two standard deviations of a compass",
        color=INK,
        fontsize=10,
    )
    figure.savefig(picture, dpi=80)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "lookouts.png")
