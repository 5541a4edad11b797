"""What is foretold of a way, against the Cramer-Rao bound of the same sights, which another code computes."""

from dataclasses import replace

import numpy as np
import pytest

from distloc.advice.advise import advise
from distloc.advice.foretell import half_lengths_m
from distloc.advice.ways import HEADINGS, STOPS, Craft, ways_along, ways_of
from distloc.filter.turning import Views
from distloc.geometry.camera import Camera
from distloc.study.bound import NoiseModel, position_bound
from distloc.tracks.estimates.outlook import Outlook
from distloc.types import AttitudeError, CameraPose, FloatArray, PoseErrors

CAMERA = Camera(1920, 1080, 1200.0, 1200.0, 960.0, 540.0)
CRAFT = Craft(speed_mps=10.0, flight_s=60.0)
PIXEL_PX = 2.0
NORTH = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])  # right, up and along of what looks north


def errors(heading_deg: float, tau_s: float = 100.0) -> PoseErrors:
    return PoseErrors(np.radians(heading_deg), np.radians(0.5), np.radians(0.1), 0.3, tau_s)


def outlook(told: PoseErrors, ranges_m: FloatArray, sigma_log: float = 3.0, white_rad: float = 0.0) -> Outlook:
    """Of something in the north of which next to nothing is known."""
    covariance = np.zeros((8, 8))
    covariance[0, 0], covariance[1, 1], covariance[2, 2] = sigma_log**2, 1.0, 1.0
    covariance[3:6, 3:6] = told.bias_variance
    return Outlook(
        id=1,
        pose=CameraPose(0.0, np.zeros(3), np.eye(3), heading_rad=0.0),
        errors=told,
        axes=NORTH,
        covariance=covariance,
        ranges_m=ranges_m,
        white_rad2=np.eye(2) * (white_rad or np.hypot(PIXEL_PX / CAMERA.fx, told.attitude_white_rad)) ** 2,
        aim_sigma_rad=np.zeros(2),
        sightings=10,
        also_m2=np.zeros((2, 2)),
        views=Views(),
    )


def bound_m(heading_rad: float, length_m: float, range_m: float, told: PoseErrors) -> float:
    """Half-length by the bound: from each stop as many frames at once as the filter steps between two."""
    point = np.array([0.0, range_m, 0.0])
    each = round(length_m / STOPS / 10.0)
    poses = []
    for stop in range(1, STOPS + 1):
        at_m = stop / STOPS * length_m
        place = np.array([at_m * np.sin(heading_rad), at_m * np.cos(heading_rad), 0.0])
        along = (point - place) / np.linalg.norm(point - place)
        right = np.cross(along, [0.0, 0.0, 1.0])
        R = np.stack([right, -np.cross(right, along), along])
        poses += [CameraPose(at_m / CRAFT.speed_mps, place, R)] * each
    noise = NoiseModel(
        pixel_px=PIXEL_PX,
        rotation_white_rad=told.attitude_white_rad,
        heading_bias_rad=told.heading_bias_rad,
        tilt_bias_rad=told.tilt_bias_rad,
        tau_s=told.bias_time_constant_s,
    )
    covariance = position_bound(CAMERA, poses, point, noise)[-1][:2, :2]
    return float(np.sqrt(5.991 * np.linalg.eigvalsh(covariance)[1]))


@pytest.mark.parametrize("heading_deg", [30.0, 60.0, 90.0, 290.0])
@pytest.mark.parametrize("told", [errors(2.0), errors(0.3, 1e5), errors(5.0, 30.0)], ids=["usual", "survey", "wild"])
def test_it_is_the_bound(heading_deg: float, told: PoseErrors) -> None:
    length_m, ranges_m = 960.0, np.array([1500.0, 2500.0, 4000.0])  # 60 m from stop to stop: 6 steps
    way = ways_along(np.radians([heading_deg]), np.array([length_m]), np.zeros(1), np.array([0.0, 2500.0]))
    (found,) = half_lengths_m(outlook(told, ranges_m), way, CRAFT)
    expected = [bound_m(np.radians(heading_deg), length_m, float(one), told) for one in ranges_m]
    assert found / expected == pytest.approx(1.05, abs=0.04)  # by which the particles' are larger


def test_straight_at_it_tells_next_to_nothing_and_across_tells_most() -> None:
    ways = ways_of(CRAFT, np.array([0.0, 2500.0]))
    halves = half_lengths_m(outlook(errors(1.0), np.full(5, 2500.0)), ways, CRAFT)[HEADINGS:, 2]
    assert np.argmax(halves) in (0, HEADINGS // 2)  # north or south
    best = np.degrees(ways.heading_rad[HEADINGS + int(np.argmin(halves))])
    assert 45.0 <= min(best, 360.0 - best) <= 90.0
    assert halves.min() < 0.2 * halves.max()


def test_a_surer_compass_gives_more_and_what_the_scenery_measures_is_surer() -> None:
    way = ways_along(np.array([np.pi / 3.0]), np.array([600.0]), np.zeros(1), np.array([0.0, 2000.0]))
    usual, sure = (half_lengths_m(outlook(errors(one), np.full(5, 2000.0)), way, CRAFT)[0, 2] for one in (2.0, 0.3))
    covariance = np.diag(np.radians([0.3, 0.3, 0.3]) ** 2)
    attitude = AttitudeError(covariance, 0.98 * np.eye(3), 0.04 * covariance, "scenery")
    told = outlook(errors(0.3), np.full(5, 2000.0))
    by_scenery = half_lengths_m(replace(told, pose=replace(told.pose, attitude=attitude)), way, CRAFT)[0, 2]
    assert sure < 0.7 * usual and by_scenery < sure


def test_what_is_not_seen_on_the_way_tells_nothing() -> None:
    craft = replace(CRAFT, keeps_target=False, half_view_rad=0.6)
    told = outlook(errors(1.0), np.full(5, 2500.0), sigma_log=0.3)
    ways = ways_of(craft, np.array([0.0, 2500.0]))
    halves = half_lengths_m(told, ways, craft)[HEADINGS:, 2]
    south = HEADINGS // 2
    before = float(np.sqrt(5.991) * 2500.0)  # the tangents' sigma is 1
    assert halves[south] == pytest.approx(1.05 * before, rel=0.01)
    assert halves[2] < 0.5 * before  # 30 degrees off
    found = advise(told, craft, before)
    assert found is not None and min(found.heading_rad, 2.0 * np.pi - found.heading_rad) < 0.6


def test_what_is_sure_enough_needs_no_advice_and_what_nobody_can_foretell_has_no_promise() -> None:
    told = outlook(errors(1.0), np.array([900.0, 1700.0, 2500.0, 5000.0, 9000.0]), sigma_log=0.8)
    found = advise(told, CRAFT, 5000.0)
    assert found is not None and found.half_length_m is None and 0.0 < found.likely_m < 4000.0
    sure = outlook(errors(1.0), np.full(5, 2500.0) * np.linspace(0.97, 1.03, 5), sigma_log=0.03)
    found = advise(sure, CRAFT, 400.0)
    assert found is not None and found.half_length_m is not None and found.half_length_m < 320.0
    assert advise(sure, CRAFT, 20.0) is None


def test_no_way_leads_into_the_fire() -> None:
    told = outlook(errors(1.0), np.array([350.0, 400.0, 450.0, 500.0, 550.0]), sigma_log=0.3)
    found = advise(told, CRAFT, 800.0)
    assert found is not None
    if found.kind == "leg":
        flown = np.linspace(0.0, found.length_m, 100)
        place = flown[:, None] * [np.sin(found.heading_rad), np.cos(found.heading_rad)]
        assert np.hypot(place[:, 0], place[:, 1] - 350.0).min() > 130.0
