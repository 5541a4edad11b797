"""Roots that the left or right border cuts: their uncut edges, and where the fire is beyond, as drawn plumes show."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from distloc.sights.border import Border, beyond, border_of, seen_rad_of
from distloc.sights.detections import detections_from_mask
from distloc.sights.sights import Expected, cuts_of, rays_of, sights_of
from distloc.types import CameraPose, Detection, FloatArray, PoseErrors
from tests.support.cube_samples import CAMERA, R_NORTH, empty_mask

AT = CameraPose(0.0, np.zeros(3), R_NORTH)
EXACT = PoseErrors(0.03, 0.01, 0.0, 0.0, 300.0)
UNKNOWN = np.full((1, 3), np.nan)
PX = np.full(1, 1.0)


def plume(middle_px: float, foot_px: float, width_px: float, height_px: float, lean: float) -> list[Detection]:
    """Smoke over a root so wide; it widens by a fifth to each side, and goes right by `lean` for each pixel up."""
    half, up = width_px / 2.0, height_px
    corners = [
        (middle_px - half, foot_px),
        (middle_px + half, foot_px),
        (middle_px + half + (lean + 0.2) * up, foot_px - up),
        (middle_px - half + (lean - 0.2) * up, foot_px - up),
    ]
    mask = empty_mask()
    cv2.fillPoly(mask, [np.rint(corners).astype(np.int32)], 255)
    return detections_from_mask(mask, CAMERA)


def border(side: float, **changed: float) -> Border:
    return replace(Border(side, 1900.0, 20.0, 30.0, 0.0, 3.0), **changed)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_uncut_edge_is_where_it_is_seen_and_the_fire_is_beyond_it(side: float) -> None:
    at_border = 1919.5 if side > 0.0 else -0.5
    (one,) = plume(at_border, 700.0, 60.0, 150.0, 0.4 * side)  # half of the root is seen
    (found,) = (border_of(one, CAMERA, "base"),)
    assert found is not None and found.side == side
    assert found.edge_px == pytest.approx(at_border - 30.0 * side, abs=5.0) and found.below_px == 0.0
    right_rad, sigma_rad = beyond([found], PX, UNKNOWN)
    assert right_rad[0] * side > found.width_px / 2.0 and 0.0 < sigma_rad[0] < 40.0
    assert border_of(one, CAMERA, "centre") is None
    assert border_of(replace(one, root=None), CAMERA, "base") is None
    assert border_of(replace(one, is_base_cut=(False, True)), CAMERA, "base") is None
    across = replace(one, centre_px=np.array([959.5, 600.0]), width_px=1920.0)
    assert border_of(across, CAMERA, "base") is None  # both sides cut it


def test_smoke_that_comes_in_over_the_border_may_have_its_foot_far_beyond_and_below() -> None:
    def of(lean: float) -> Border:
        (one,) = plume(1925.0, 700.0, 30.0, 200.0, lean)
        found = border_of(one, CAMERA, "base")
        assert found is not None
        return found

    inwards, outwards = of(-0.8), of(0.3)
    assert inwards.scale_px > 1.4 * outwards.scale_px
    assert inwards.below_px > 40.0 and outwards.below_px < 10.0


def test_what_is_hidden_goes_by_what_was_seen_of_late_and_of_a_whole_root_by_that() -> None:
    one, whole = border(1.0), np.array([[40.0, 60.0, np.nan]])
    assert np.ravel(beyond([one], PX, UNKNOWN)).tolist() == [25.0, 15.0]
    assert np.ravel(beyond([border(-1.0)], PX, UNKNOWN)).tolist() == [-25.0, 15.0]
    assert np.ravel(beyond([one], PX, whole)).tolist() == [50.0, 30.0]
    assert np.ravel(beyond([one], PX, np.array([[40.0, 60.0, 24.0]]))).tolist() == [18.0, 6.0]  # most of it is seen
    assert np.ravel(beyond([one], PX, np.array([[40.0, 60.0, 90.0]]))).tolist() == [50.0, 30.0]  # a sliver of it
    assert np.ravel(beyond([None], PX, whole)).tolist() == [0.0, 0.0]
    assert np.isnan(seen_rad_of([None], PX)).all() and seen_rad_of([one], 2.0 * PX).tolist() == [[40.0, 60.0]]


def told_px(one: Detection) -> tuple[FloatArray, FloatArray]:
    """Where the sight goes through the picture, and one standard deviation across and up."""
    (ray,) = rays_of(CAMERA, AT, [one], "base")
    unknown = Expected(np.array([1000.0]), np.full((1, 2), np.nan), np.zeros((1, 2)), UNKNOWN)
    sight = sights_of([ray], unknown, EXACT, 1.0)
    pixel, _ = CAMERA.project(R_NORTH @ sight.axes[0, 2][:, None])
    along, across_rad = cuts_of([ray], unknown.size_px)
    hidden_rad = beyond([ray.border], np.array([ray.px_rad]), UNKNOWN)[1][0]
    covariance = sight.covariance[0] + along[0] + np.diag(np.square(across_rad[0]))
    covariance[0, 0] += hidden_rad**2
    return pixel[:, 0], np.sqrt(np.diag(covariance)) / ray.px_rad


def test_of_plumes_cut_at_a_side_nineteen_in_twenty_are_where_it_is_told_and_the_height_stays() -> None:
    rng, inside, sigmas_px = np.random.default_rng(7), [], []
    while len(inside) < 160:
        width_px = float(np.exp(rng.uniform(np.log(8.0), np.log(80.0))))
        height_px, lean = width_px * rng.uniform(2.0, 6.0), float(rng.normal(0.0, 0.5))
        beyond_px = width_px * rng.uniform(-0.5, 1.0)  # a third has none of its root in the picture
        for one in plume(1919.5 + beyond_px, 700.0, width_px, height_px, lean)[:1]:
            if one.touches_border and one.is_base_cut[0]:
                pixel, sigma_px = told_px(one)
                inside.append(abs(pixel[0] - 1919.5 - beyond_px) < 1.96 * sigma_px[0])
                sigmas_px.append(sigma_px[0])
                if one.is_cut[1] is False and lean > 0.2:
                    assert abs(pixel[1] - 700.0) < 15.0 and sigma_px[1] < 0.1 * one.height_px + 3.0
    assert 0.93 < np.mean(inside) < 0.995
    assert 2.0 < np.median(sigmas_px) < 0.05 * CAMERA.width  # a picture's twentieth is what nobody knows else


def test_a_corner_loses_both_axes() -> None:
    (one,) = plume(1915.0, 1085.0, 60.0, 200.0, 0.1)
    assert one.is_base_cut == (True, True)
    pixel, sigma_px = told_px(one)
    assert pixel[0] > 1885.0 and sigma_px[0] > 15.0 and sigma_px[1] > 50.0
