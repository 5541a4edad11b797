"""Errors of a heading that change as the craft turns: forgotten in turns, and in the ellipse of who flies around."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from distloc.filter.turning import HeadingOrAzimuth, TurnRate, Views, camera_azimuth_rad
from distloc.filter.uncertainty import blurred, ellipse_holds
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.localizer import Localizer, LocalizerConfig
from distloc.simulation.pose_noise import CorrelatedPoseErrors, CorrelatedSigmas
from distloc.simulation.targets import Box
from distloc.types import CameraPose, Ellipse, FloatArray, PoseErrors, TargetState

CAMERA = Camera(1280, 720, 900.0, 900.0, 640.0, 360.0)
ERRORS = LocalizerConfig().pose_errors
IRON_RAD = ERRORS.heading_bias_rad * 0.5**0.5
PlaceAt = Callable[[float], tuple[float, float, float]]
STEPS = 80
TURN_RATE_RPS = float(np.radians(1.8))
COMPASS = CorrelatedSigmas(
    heading_bias_rad=float(np.radians(1.4)), heading_iron_rad=float(np.radians(1.4)), tilt_bias_rad=0.0, tau_s=1e5
)


def pose(stamp_s: float, heading_rad: float | None) -> CameraPose:
    return CameraPose(stamp_s, np.zeros(3), np.eye(3), heading_rad=heading_rad)


def errors_after(headings_rad: list[float | None], step_s: float = 0.4, errors: PoseErrors = ERRORS) -> PoseErrors:
    rate = TurnRate()
    return [rate.take(pose(step_s * k, heading), errors) for k, heading in enumerate(headings_rad)][-1]


def test_a_turn_makes_slow_errors_forget_themselves_sooner() -> None:
    turning = errors_after([TURN_RATE_RPS * 0.4 * k for k in range(100)])
    assert turning.bias_time_constant_s == pytest.approx(1.0 / (1.0 / 120.0 + TURN_RATE_RPS / 2.0), rel=1e-3)
    assert replace(turning, bias_time_constant_s=120.0) == ERRORS
    through_north = errors_after([(6.0 - TURN_RATE_RPS * 0.4 * k) % (2.0 * np.pi) for k in range(1000)])
    assert through_north.bias_time_constant_s == pytest.approx(turning.bias_time_constant_s, rel=1e-3)


def test_straight_flights_and_unknown_headings_change_nothing() -> None:
    assert errors_after([1.0] * 50) == ERRORS
    assert errors_after([None] * 50) == ERRORS
    for_good = replace(ERRORS, bias_turn_rad=np.inf)
    assert errors_after([0.1 * k for k in range(50)], errors=for_good) == for_good
    rocking = errors_after([float(np.radians(1.0)) * (-1.0) ** k for k in range(50)])
    assert 95.0 < rocking.bias_time_constant_s < 120.0


def test_a_clock_that_stands_or_goes_back_is_no_turn() -> None:
    rate = TurnRate()
    for stamp_s, heading_rad in ((1.0, 0.0), (1.0, 3.0), (0.5, 1.0)):
        assert rate.take(pose(stamp_s, heading_rad), ERRORS) == ERRORS


def views_from(places_m: FloatArray, headings_rad: FloatArray, errors: PoseErrors = ERRORS) -> Views:
    views = Views()
    for (east_m, north_m), heading_rad in zip(places_m.T, headings_rad, strict=True):
        at = CameraPose(0.0, np.array([east_m, north_m, 120.0]), np.eye(3), heading_rad=float(heading_rad))
        views.add(at, errors)
    return views


def circle(radius_m: float, arc_rad: float = 2.0 * np.pi, count: int = 60) -> tuple[FloatArray, FloatArray]:
    """Places (2, n) on a circle about the origin, and the azimuths (n,) at which they are seen from there."""
    azimuths = np.linspace(0.0, arc_rad, count, endpoint=False)
    return radius_m * np.array([np.sin(azimuths), np.cos(azimuths)]), azimuths


def axes_m(covariance_m2: FloatArray) -> list[float]:
    return np.sqrt(np.linalg.eigvalsh(covariance_m2)).tolist()


@pytest.mark.parametrize("arc_rad", [2.0 * np.pi, np.pi, np.pi / 2.0])
@pytest.mark.parametrize("rounds", [1, 5])
def test_about_a_target_it_is_the_error_times_the_range_whatever_the_arc(arc_rad: float, rounds: int) -> None:
    places_m, azimuths = circle(900.0, arc_rad)
    views = views_from(np.tile(places_m, rounds), np.tile(azimuths + np.pi, rounds))
    assert axes_m(views.covariance_m2(np.zeros(3), ERRORS)) == pytest.approx([900.0 * IRON_RAD] * 2, rel=0.02)


def test_a_loiter_beside_a_target_moves_it_along_the_line_of_sight_by_the_range_squared_over_the_radius() -> None:
    places_m, azimuths = circle(150.0)
    target_enu_m = np.array([0.0, 1500.0, 100.0])
    covariance_m2 = views_from(places_m, azimuths + np.pi / 2.0).covariance_m2(target_enu_m, ERRORS)
    assert np.sqrt(covariance_m2[1, 1]) == pytest.approx(IRON_RAD * 1500.0**2 / 150.0, rel=0.1)


def test_straight_ahead_it_is_nothing_and_so_for_who_knows_no_heading() -> None:
    places_m = np.stack([np.linspace(-500.0, 500.0, 60), np.full(60, -1000.0)])
    assert max(axes_m(views_from(places_m, np.full(60, 0.7)).covariance_m2(np.zeros(3), ERRORS))) < 1.0
    around_m, azimuths = circle(900.0)
    for_good = replace(ERRORS, bias_turn_rad=np.inf)
    assert (
        views_from(around_m, azimuths, for_good).covariance_m2(np.zeros(3), ERRORS).tolist()
        == np.zeros((2, 2)).tolist()
    )
    views = Views()
    views.add(pose(0.0, None), ERRORS)
    assert views.rows.shape == (0, 4) and not views.covariance_m2(np.zeros(3), ERRORS).any()


def test_views_are_few_and_spread_over_all_sightings() -> None:
    places_m, azimuths = circle(900.0, count=1000)
    views = views_from(places_m, azimuths)
    rows = views.rows
    assert 32 <= len(rows) <= 64
    assert np.diff(rows[:, 2]).max() == pytest.approx(np.diff(rows[:, 2]).min()) and rows[-1, 2] > 0.9 * azimuths[-1]
    assert axes_m(views.covariance_m2(np.zeros(3), ERRORS)) == pytest.approx([900.0 * IRON_RAD] * 2, rel=0.05)
    assert Views(rows).rows.tolist() == rows.tolist()


def test_an_ellipse_with_an_error_more() -> None:
    told = blurred(Ellipse(300.0, 40.0, 1.0), 100.0**2 * np.eye(2))
    assert told.azimuth_rad == pytest.approx(1.0)
    assert (told.semi_major_m, told.semi_minor_m) == pytest.approx(
        (np.hypot(300.0, 244.8), np.hypot(40.0, 244.8)), rel=1e-3
    )
    north = blurred(Ellipse(40.0, 40.0, 1.0), np.diag([0.0, 100.0**2]))
    assert (north.semi_major_m, north.semi_minor_m) == pytest.approx((np.hypot(40.0, 244.8), 40.0), rel=1e-3)
    assert np.sin(north.azimuth_rad) == pytest.approx(0.0, abs=1e-6)
    assert blurred(Ellipse(300.0, 40.0, 1.0), np.zeros((2, 2))).semi_minor_m == pytest.approx(40.0)


def at_end(
    place_at: Callable[[float], tuple[float, float, float]],
    seed: int,
    config: LocalizerConfig,
    says_heading: bool = True,
) -> tuple[bool, bool]:
    """Whether the ellipse after one flight with such a compass holds the truth, and whether the target is confirmed.

    `place_at` gives east, north and heading by the share of the flight; the camera is held at the target.
    """
    target_enu_m = np.array([0.0, 0.0, 150.0])

    def pose_at(stamp_s: float) -> CameraPose:
        east_m, north_m, heading_rad = place_at(stamp_s / STEPS)
        place_enu_m = np.array([east_m, north_m, 120.0])
        away_enu_m = target_enu_m - place_enu_m
        yaw_rad = np.arctan2(away_enu_m[0], away_enu_m[1])
        R = R_cam_from_enu(matrix_from_euler(yaw_rad, 0.0, 0.0), np.eye(3))
        return CameraPose(stamp_s, place_enu_m, R, heading_rad=heading_rad % (2.0 * np.pi))

    compass = CorrelatedPoseErrors(COMPASS, np.random.default_rng([3, seed]))
    located = Localizer(CAMERA, config, rng=np.random.default_rng(seed))
    for step in range(STEPS):
        mask = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
        Box(target_enu_m, (30.0, 30.0, 30.0)).draw(mask, CAMERA, pose_at(float(step)))
        reported = compass.reported(pose_at, float(step))
        told = located.step(reported if says_heading else replace(reported, heading_rad=None), mask)
    off_m = (target_enu_m - told[0].position_enu_m)[:2]
    return ellipse_holds(told[0].ellipse95, off_m), told[0].state is TargetState.CONFIRMED


def orbit(share: float) -> tuple[float, float, float]:
    azimuth = 2.0 * np.pi * share
    return 1000.0 * np.sin(azimuth), 1000.0 * np.cos(azimuth), azimuth + np.pi


def arcs(share: float) -> tuple[float, float, float]:
    """To and fro over a quarter of a circle."""
    azimuth = np.pi / 2.0 * abs((4.0 * share) % 2.0 - 1.0)
    return 1000.0 * np.sin(azimuth), 1000.0 * np.cos(azimuth), azimuth + np.pi


def loiter(share: float) -> tuple[float, float, float]:
    """Twice around a place far from the target."""
    azimuth = 4.0 * np.pi * share
    return 150.0 * np.sin(azimuth), -1500.0 + 150.0 * np.cos(azimuth), azimuth + np.pi / 2.0


@pytest.mark.thorough
@pytest.mark.parametrize("place_at", [orbit, arcs, loiter])
def test_a_compass_with_iron_about_it_does_not_make_the_ellipse_too_sure(
    place_at: PlaceAt,
) -> None:
    config = LocalizerConfig(n_particles=3000, step_distance_m=0.0, step_interval_s=0.0, position_sigma_m=0.3)
    lasting = replace(config, bias_turn_rad=np.inf, bias_time_constant_s=600.0)
    holds, is_confirmed = np.array([at_end(place_at, seed, config) for seed in range(20)]).T
    assert holds.sum() >= 17  # of 0.95 fewer come in 1.6 of 100 times
    assert (holds | ~is_confirmed).sum() >= 18
    too_sure, _ = np.array([at_end(place_at, seed, lasting) for seed in range(10)]).T
    assert too_sure.sum() <= 5


def test_who_gives_no_heading_is_not_too_sure_either() -> None:
    config = LocalizerConfig(n_particles=2000, step_distance_m=0.0, step_interval_s=0.0, position_sigma_m=0.3)
    holds = [at_end(orbit, seed, config, says_heading=False)[0] for seed in range(8)]
    assert sum(holds) >= 7


@pytest.mark.parametrize("pitch_deg", [20.0, -5.0, -60.0, -90.0])
@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.5])
def test_a_cameras_azimuth_is_known_down_to_the_nadir(pitch_deg: float, yaw_rad: float) -> None:
    R = R_cam_from_enu(matrix_from_euler(yaw_rad, float(np.radians(pitch_deg)), 0.0), np.eye(3))
    assert camera_azimuth_rad(R) == pytest.approx(yaw_rad)


def looking(yaw_deg: float) -> CameraPose:
    yaw_rad = float(np.radians(yaw_deg))
    return CameraPose(0.0, np.zeros(3), R_cam_from_enu(matrix_from_euler(yaw_rad, -0.1, 0.0), np.eye(3)))


def test_the_azimuth_stands_in_once_the_camera_has_turned() -> None:
    watch = HeadingOrAzimuth()
    told = [watch.take(looking(yaw_deg)).heading_rad for yaw_deg in (350.0, 5.0, 15.0, 8.0, 21.0, 350.0)]
    assert told[:4] == [None] * 4 and told[4:] == pytest.approx(np.radians([21.0, -10.0]).tolist())
    known = replace(looking(90.0), heading_rad=0.3)
    assert HeadingOrAzimuth().take(known) is known and watch.take(known) is known
