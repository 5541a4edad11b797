"""What reports are made of: numbers as JSON has them, ellipses, sizes, the plume. The wire puts them together."""

import math
from typing import Literal

import msgspec

from distloc.filter.uncertainty import NORMAL90, circular_error90_m
from distloc.types import Ellipse, Extent, FloatArray
from service.common.messages import LocatedTarget, VehicleState

Number = float | None  # None stands for what is not finite: JSON has no NaN


class EllipseReport(msgspec.Struct, frozen=True, kw_only=True):
    """Semi-axes, and the major axis' azimuth clockwise from north."""

    semi_major_m: Number
    semi_minor_m: Number
    azimuth_deg: Number


class ExtentReport(msgspec.Struct, frozen=True, kw_only=True):
    """The plume's size as seen, with one standard deviation of each."""

    width: Number
    width_sigma: Number
    height: Number
    height_sigma: Number


class PlumeReport(msgspec.Struct, frozen=True, kw_only=True):
    """The smoke over the fire: its middle [lon, lat] and height over the sea, its size, how far it leans and where to.

    `lean_deg` is off the vertical, `drift_deg` clockwise from north.
    """

    centre: list[float] | None
    altitude_msl_m: Number
    extent_m: ExtentReport
    lean_deg: Number
    drift_deg: Number


class ViewReport(msgspec.Struct, frozen=True, kw_only=True):
    """Where the camera looks: azimuth clockwise from north, elevation up, angles of view from edge to edge."""

    azimuth_deg: float
    elevation_deg: float
    hfov_deg: float
    vfov_deg: float


class AdviceReport(msgspec.Struct, frozen=True, kw_only=True):
    """Where to fly to make it surer, and the 95 % ellipse's half-length that it is likely to give, null if unsure.

    A `leg` goes straight at `heading_deg`, clockwise from north; an `arc` begins so and turns about the fire.
    """

    kind: Literal["leg", "arc"]
    heading_deg: Number
    length_m: Number
    seconds: Number
    half_length_m: Number


def advice_report(target: LocatedTarget) -> AdviceReport | None:
    """The advice as it goes out; None where there is none."""
    advice = target.advice
    if advice is None:
        return None
    return AdviceReport(
        kind=advice.kind,
        heading_deg=azimuth_deg(advice.heading_rad, 360.0),
        length_m=rounded(advice.length_m, 1),
        seconds=rounded(advice.seconds, 1),
        half_length_m=None if advice.half_length_m is None else rounded(advice.half_length_m, 1),
    )


def rounded(value: float, digits: int = 3) -> Number:
    """`value` to so many decimals, None where it is not finite, and never -0.0."""
    number = float(value)
    return round(number, digits) + 0.0 if math.isfinite(number) else None


def ellipse_report(ellipse: Ellipse) -> EllipseReport:
    return EllipseReport(
        semi_major_m=rounded(ellipse.semi_major_m),
        semi_minor_m=rounded(ellipse.semi_minor_m),
        azimuth_deg=azimuth_deg(ellipse.azimuth_rad, 180.0),
    )


def ce90_m(covariance_enu_m2: FloatArray) -> Number:
    """The radius of the circle that holds the place with 90 % probability."""
    return rounded(circular_error90_m(covariance_enu_m2[:2, :2]))


def le90_m(covariance_enu_m2: FloatArray) -> Number:
    """Half of the height's interval of 90 %."""
    variance_m2 = float(covariance_enu_m2[2, 2])
    return rounded(NORMAL90 * math.sqrt(variance_m2)) if variance_m2 >= 0.0 else None


def degrees(angle_rad: float | None) -> Number:
    return None if angle_rad is None else rounded(math.degrees(angle_rad))


def sigma_deg(sigma_rad: float) -> Number:
    """None where there is none: nothing is known to 0 degrees."""
    return rounded(math.degrees(sigma_rad)) if sigma_rad > 0.0 else None


def azimuth_deg(azimuth_rad: float, period_deg: float) -> Number:
    degrees = rounded(math.degrees(azimuth_rad))
    return None if degrees is None else rounded(degrees % period_deg)


def extent_report(extent: Extent) -> ExtentReport:
    """A size as it goes out."""
    return ExtentReport(
        width=rounded(extent.width_m),
        width_sigma=rounded(extent.width_sigma_m),
        height=rounded(extent.height_m),
        height_sigma=rounded(extent.height_sigma_m),
    )


def plume_report(target: LocatedTarget) -> PlumeReport | None:
    """The smoke over a fire; None where the target is the smoke itself."""
    plume, place = target.estimate.plume, target.plume_place
    if plume is None or place is None:
        return None
    lon, lat = rounded(place.lon_deg, 8), rounded(place.lat_deg, 8)
    return PlumeReport(
        centre=None if lon is None or lat is None else [lon, lat],
        altitude_msl_m=rounded(place.alt_msl_m),
        extent_m=extent_report(target.estimate.extent),
        lean_deg=degrees(plume.lean_rad),
        drift_deg=azimuth_deg(plume.drift_rad, 360.0),
    )


def view_report(state: VehicleState) -> ViewReport | None:
    """By the camera's axis, the third row of its rotation; None where that or the lens is not known."""
    east, north, up = (float(one) for one in state.pose.R_cam_from_enu[2])
    if state.fov_rad is None or not math.isfinite(east + north + up):
        return None
    hfov_rad, vfov_rad = state.fov_rad
    return ViewReport(
        azimuth_deg=round(math.degrees(math.atan2(east, north)) % 360.0, 2),
        elevation_deg=round(math.degrees(math.atan2(up, math.hypot(east, north))), 2),
        hfov_deg=round(math.degrees(hfov_rad), 2),
        vfov_deg=round(math.degrees(vfov_rad), 2),
    )
