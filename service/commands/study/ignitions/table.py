"""What `study fires` prints and writes: a line a fire, what is true of all, each platform's bias."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from distloc.study.ignitions.biases import Bias
from distloc.study.ignitions.scored import Answer, Overall, Scored, overall
from service.commands.study.files import cell, rounded, write_csv, write_json

_WAYS = ("nominal", "estimated")
_MEANS = {
    Answer.ROUGH: "the region is over half the range",
    Answer.DISAGREE: "the platforms disagree and nobody knows which is right",
    Answer.BEARING: "one direction only",
    Answer.NOTHING: "no sighting could be used",
}


def printed(by_nominal: Sequence[Scored], by_estimated: Sequence[Scored]) -> list[str]:
    """A line for each fire by both ways, then all fires."""
    width = max(len("fire"), *(len(one.fire) for one in by_nominal))
    lines = [
        f"{'':{width}}  {'':>9}  {'nominal biases':<34}  {'estimated from the other fires':<34}",
        f"{'fire':{width}}  {'platforms':>9}  {_HEAD}  {_HEAD}".rstrip(),
    ]
    for one, other in zip(by_nominal, by_estimated, strict=True):
        lines.append(f"{one.fire:{width}}  {one.platforms:>9}  {_answer(one)}  {_answer(other)}".rstrip())
    lines.append("")
    for way, fires in zip(_WAYS, (by_nominal, by_estimated), strict=True):
        lines.append(_of_all(way, overall(fires)))
        why = Counter(one.answer for one in fires if not one.is_located)
        if why:
            reasons = "; ".join(f"{count} because {_MEANS[answer]}" for answer, count in sorted(why.items()))
            lines.append(f"{'':9}  abstained: {reasons}")
    return lines


def written(
    out: Path,
    by_nominal: Sequence[Scored],
    by_estimated: Sequence[Scored],
    biases: Mapping[str, Bias],
    pooled: Callable[[Sequence[Scored]], Overall],
) -> list[str]:
    """fires.csv (a line a fire and way), fires.json (with what is true of all) and biases.csv; their names."""
    both = list(zip(_WAYS, (by_nominal, by_estimated), strict=True))
    rows = [row for way, fires in both for row in (_row(way, one) for one in fires)]
    write_csv(out / "fires.csv", rows)
    write_json(
        out / "fires.json", {"overall": {way: _overall_row(pooled(fires)) for way, fires in both}, "fires": rows}
    )
    names = ["fires.csv", "fires.json"]
    if biases:
        write_csv(out / "biases.csv", [_bias_row(name, one) for name, one in biases.items()])
        names.append("biases.csv")
    return names


_HEAD = f"{'answer':<9} {'error km':>8} {'km2':>8} {'holds':>5}"


def _answer(one: Scored) -> str:
    if one.error_m is None or one.area_km2 is None:
        return f"{one.answer.value:<9} {'-':>8} {'-':>8} {'-':>5}"
    error_km = cell(one.error_m / 1e3, 8, 2)
    return f"{one.answer.value:<9} {error_km} {cell(one.area_km2, 8, 1)} {'yes' if one.holds else 'NO':>5}"


def _of_all(way: str, of: Overall) -> str:
    if not of.located:
        return f"{way:<9}  none of {of.fires} fires located"
    low, high = of.coverage95
    return (
        f"{way:<9}  the 95 % region holds the ignition of {of.held} of {of.located} located fires: "
        f"{of.coverage:.2f} ({low:.2f} to {high:.2f}); median error {of.error_m / 1e3:.2f} km "
        f"(90 %: {of.error90_m / 1e3:.2f}), area {of.area_km2:.1f} km2; "
        f"abstained {100.0 * of.abstained:.0f} % of {of.fires}"
    )


def _row(way: str, one: Scored) -> dict[str, Any]:
    ellipse = one.ellipse95
    return {
        "fire": one.fire,
        "biases": way,
        "answer": one.answer.value,
        "platforms": one.platforms,
        "sightings": one.sightings,
        "unused": one.unused,
        "lat": rounded(one.lat_deg, 6),
        "lon": rounded(one.lon_deg, 6),
        "semi_major_m": rounded(ellipse.semi_major_m, 1) if ellipse else None,
        "semi_minor_m": rounded(ellipse.semi_minor_m, 1) if ellipse else None,
        "azimuth_deg": rounded(math.degrees(ellipse.azimuth_rad), 1) if ellipse else None,
        "area_km2": rounded(one.area_km2, 3),
        "error_m": rounded(one.error_m, 1),
        "holds": one.holds,
        "smoke_offset_m": rounded(one.smoke_m, 1),
    }


def _overall_row(of: Overall) -> dict[str, Any]:
    low, high = of.coverage95
    return {
        "fires": of.fires,
        "located": of.located,
        "held": of.held,
        "coverage": rounded(of.coverage, 4),
        "coverage_low": rounded(low, 4),
        "coverage_high": rounded(high, 4),
        "error_median_m": rounded(of.error_m, 1),
        "error_90_m": rounded(of.error90_m, 1),
        "area_median_km2": rounded(of.area_km2, 3),
        "abstained": rounded(of.abstained, 4),
    }


def _bias_row(name: str, one: Bias) -> dict[str, Any]:
    return {
        "platform": name,
        "bias_deg": round(math.degrees(one.mean_rad), 3),
        "sigma_deg": round(math.degrees(one.sigma_rad), 3),
        "fires": one.fires,
    }
