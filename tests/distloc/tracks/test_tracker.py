"""Many targets through the localizer: each scene of the method's list with the outcome that is right."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.filter.ground import FlatGround
from distloc.filter.uncertainty import ellipse_holds
from distloc.geometry.camera import Camera
from distloc.geometry.rotations import matrix_from_rotation_vector
from distloc.localizer import Localizer, LocalizerConfig
from distloc.sights.detections import detections_from_mask
from distloc.simulation.mask_noise import MaskNoise, MaskNoiser
from distloc.simulation.targets import Box
from distloc.tracks.belief import Belief
from distloc.tracks.tracker import Tracker
from distloc.types import CameraPose, Detection, PoseErrors, TargetEstimate, TargetState
from tests.support.cube_samples import CAMERA, CUBE_ENU_M, R_NORTH, cube_mask, empty_mask, pose_at
from tests.support.towers import looking_at

Mask = NDArray[np.uint8]
# a cube has no root: its centre is aimed at; the bias is one flight long: tracks are what is tested
CONFIG = LocalizerConfig(n_particles=6000, bias_time_constant_s=600.0, aim="centre")
CUBE = Box(CUBE_ENU_M)


def localizer(seed: int = 0, config: LocalizerConfig = CONFIG) -> Localizer:
    return Localizer(CAMERA, config, rng=np.random.default_rng(seed))


def drawn(pose: CameraPose, *boxes: Box) -> Mask:
    mask = empty_mask()
    for box in boxes:
        box.draw(mask, CAMERA, pose)
    return mask


def turned(pose: CameraPose, right_rad: float) -> CameraPose:
    """The same camera, looking to the right of where it looked."""
    R_enu_from_cam = matrix_from_rotation_vector(np.array([0.0, 0.0, -right_rad])) @ pose.R_cam_from_enu.T
    return replace(pose, R_cam_from_enu=np.ascontiguousarray(R_enu_from_cam.T))


def rectangle(mask: Mask, u: int, v: int, width: int = 50, height: int = 40) -> Mask:
    mask[v : v + height, u : u + width] = 255
    return mask


def flown(
    located: Localizer, steps: Iterable[int], mask_at: Callable[[int, CameraPose], Mask]
) -> list[list[TargetEstimate]]:
    """The estimates of each step; step k is at 10 k metres east."""
    return [located.step(pose_at(10.0 * k), mask_at(k, pose_at(10.0 * k))) for k in steps]


def of_cube(_: int, pose: CameraPose) -> Mask:
    return drawn(pose, CUBE)


def told(estimates: list[list[TargetEstimate]], *states: TargetState) -> set[int]:
    return {one.id for step in estimates for one in step if one.state in states}


def confirmed(estimates: list[list[TargetEstimate]]) -> set[int]:
    return told(estimates, TargetState.CONFIRMED)


def error_m(one: TargetEstimate, box: Box) -> float:
    return float(np.linalg.norm(one.position_enu_m - box.position_enu_m))


def nearest_ids(estimates: list[list[TargetEstimate]], box: Box) -> list[int]:
    """For each step with a target that was believed once, the id of that nearest to a box on the map."""
    ids = []
    for step in estimates:
        known = [one for one in step if one.state in (TargetState.CONFIRMED, TargetState.COASTING)]
        if known:
            ids.append(min(known, key=lambda one: float(np.hypot(*(one.position_enu_m - box.position_enu_m)[:2]))).id)
    return ids


def test_tentative_confirmed_coasting_and_the_same_id_when_it_comes_back() -> None:
    located = localizer()
    before = flown(located, range(31), of_cube)
    assert [len(step) for step in before[:5]] == [0, 0, 0, 1, 1]  # told of at the fourth sighting
    states = [step[0].state for step in before[3:]]
    assert states[:4] == [TargetState.TENTATIVE] * 4  # and believed at the eighth at the earliest
    first = states.index(TargetState.CONFIRMED)
    assert 4 <= first < 15 and set(states[first:]) == {TargetState.CONFIRMED}
    for k in range(31, 61):
        (away,) = located.step(turned(pose_at(10.0 * k), np.pi), empty_mask())
        assert (away.id, away.state, away.misses, away.last_seen_s) == (1, TargetState.COASTING, 0, 30.0)
    assert error_m(away, CUBE) == pytest.approx(error_m(before[-1][0], CUBE))
    after = flown(located, range(61, 91), of_cube)
    assert {one.state for step in after for one in step} == {TargetState.CONFIRMED}
    assert told(before + after, *TargetState) == {1}
    assert after[-1][0].observations == 61
    assert error_m(after[-1][0], CUBE) < 60.0


def test_dismissed_after_misses_in_a_row_in_view_told_once_and_the_next_has_a_new_id() -> None:
    located = localizer()
    flown(located, range(25), of_cube)
    nothing: Callable[[int, CameraPose], Mask] = lambda k, pose: empty_mask()  # noqa: E731
    pause = flown(located, range(25, 49), nothing)
    assert [(step[0].state, step[0].misses) for step in pause] == [(TargetState.COASTING, n) for n in range(1, 25)]
    (back,) = flown(located, [49], of_cube)[0]
    assert (back.id, back.state, back.misses) == (1, TargetState.CONFIRMED, 0)
    flown(located, range(50, 75), nothing)  # seen 26 times
    (last,) = flown(located, [75], nothing)[0]
    assert (last.id, last.state) == (1, TargetState.DISMISSED)
    assert located.particles_enu_m(1) is None
    assert flown(located, [76], nothing) == [[]]
    assert told(flown(located, range(77, 91), of_cube), *TargetState) == {2}


def test_what_was_seen_for_moments_is_dismissed_after_five_misses_and_nothing_is_missed_for_ever() -> None:
    for seen, misses in ((8, 5), (60, 30)):
        located = localizer()
        flown(located, range(seen), of_cube)
        for k in range(seen, seen + misses):
            (one,) = located.step(replace(pose_at(10.0 * seen), stamp_s=float(k)), empty_mask())
        assert (one.state, one.misses) == (TargetState.DISMISSED, misses)


def test_turned_away_between_the_misses_does_not_dismiss() -> None:
    located = localizer()
    flown(located, range(25), of_cube)
    flown(located, range(25, 49), lambda k, pose: empty_mask())
    away = [located.step(turned(pose_at(10.0 * k), 1.5), empty_mask())[0] for k in range(49, 79)]
    assert {(one.state, one.misses) for one in away} == {(TargetState.COASTING, 24)}
    (gone,) = flown(located, [79], lambda k, pose: empty_mask())[0]
    assert gone.state is TargetState.DISMISSED


@pytest.mark.parametrize("trusts_border", [False, True])
def test_a_segment_cut_by_the_border_does_not_bias(trusts_border: bool) -> None:
    def ended(is_cut: bool, seed: int) -> TargetEstimate:
        located = localizer(seed)
        for k in range(51):
            pose = replace(pose_at(10.0 * k), heading_rad=0.5 * np.pi)  # it is the camera that turns, not the craft
            if 20 <= k < 30 and is_cut:
                # right of the middle by less than half the image: the cube's centre lies on the left border
                bearing = float(np.arctan2(CUBE_ENU_M[0] - 10.0 * k, CUBE_ENU_M[1]))
                pose = turned(pose, bearing + float(np.arctan(959.5 / 1200.0)))
            found = detections_from_mask(drawn(pose, CUBE), CAMERA)
            assert found[0].touches_border is (20 <= k < 30 and is_cut)
            if trusts_border:
                found = [replace(found[0], touches_border=False)]
            estimates = located.step_detections(pose, found)
        (one,) = estimates
        assert (one.id, one.state) == (1, TargetState.CONFIRMED)
        return one

    moved_m = [
        np.linalg.norm(ended(True, seed).position_enu_m - ended(False, seed).position_enu_m) for seed in range(4)
    ]
    assert 0.0 < np.mean(moved_m) < 40.0  # 2 % of the range
    assert error_m(ended(True, 0), CUBE) < 60.0


def test_a_fire_that_comes_into_view_over_the_border_is_not_pulled_into_the_image() -> None:
    fire = Box(np.array([1700.0, 2000.0, 50.0]))  # 6 px of it a step, over the right border

    def ended(has_border: bool, seed: int) -> TargetEstimate:
        located = localizer(seed)
        for k in range(61):
            found = detections_from_mask(drawn(pose_at(10.0 * k), fire), CAMERA)
            estimates = located.step_detections(
                pose_at(10.0 * k), [one for one in found if has_border or not one.touches_border]
            )
        return estimates[0]

    errors_m = [error_m(ended(True, seed), fire) for seed in range(6)]
    without_m = [error_m(ended(False, seed), fire) for seed in range(6)]
    chance_m = 2.0 * float(np.std(errors_m)) / np.sqrt(6.0)  # of their mean
    assert np.mean(errors_m) < 2.0 * np.mean(without_m) + 20.0 + chance_m


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_side_that_is_missing_for_ten_frames_hardly_moves_the_estimate(share: float) -> None:
    def masks(k: int, pose: CameraPose) -> Mask:
        mask = drawn(pose, CUBE)
        if 20 <= k < 30:
            columns = np.flatnonzero(mask.any(axis=0))
            mask[:, columns[0] : columns[0] + int(share * columns.size)] = 0
        return mask

    (one,) = flown(localizer(), range(61), masks)[-1]
    assert (one.id, one.state) == (1, TargetState.CONFIRMED)
    assert error_m(one, CUBE) < 30.0


def test_partial_masks_hardly_move_the_estimate() -> None:
    whole, partial = [], []
    for seed in range(3):
        noiser = MaskNoiser(MaskNoise(partial_rate=0.1), CAMERA, np.random.default_rng(seed))
        whole.append(error_m(flown(localizer(seed), range(61), of_cube)[-1][0], CUBE))
        noisy = flown(localizer(seed), range(61), lambda k, pose, by=noiser: by.apply(drawn(pose, CUBE)))
        assert confirmed(noisy) == {1}
        partial.append(min(error_m(one, CUBE) for one in noisy[-1] if one.state is TargetState.CONFIRMED))
    assert np.mean(partial) < np.mean(whole) + 25.0
    assert 0.0 < np.mean(whole) < 40.0


@pytest.mark.parametrize("fire_from", [0, 1, 3])
@pytest.mark.parametrize("corner", [(300, 700), (1000, 560), (1200, 640), (1700, 100)])
def test_a_false_positive_in_the_first_frames_does_not_capture(corner: tuple[int, int], fire_from: int) -> None:
    def masks(k: int, pose: CameraPose) -> Mask:
        mask = drawn(pose, CUBE) if k >= fire_from else empty_mask()
        return rectangle(mask, *corner) if k < 5 else mask

    estimates = flown(localizer(), range(51), masks)
    assert len(confirmed(estimates)) == 1
    (fire,) = [one for one in estimates[-1] if one.state is TargetState.CONFIRMED]
    assert len(estimates[-1]) == 1
    assert error_m(fire, CUBE) < 60.0
    assert fire.observations == 51 - fire_from  # every sighting is its own


def test_two_fires_300_m_apart_keep_their_ids() -> None:
    fires = [Box(np.array([x, 2000.0, 100.0])) for x in (150.0, 450.0)]
    for seed in range(3):
        estimates = flown(localizer(seed), range(61), lambda k, pose: drawn(pose, *fires))
        assert told(estimates, *TargetState) == {1, 2}
        assert confirmed(estimates) == {1, 2}
        ids = [set(nearest_ids(estimates[25:], fire)) for fire in fires]
        assert sorted(map(len, ids)) == [1, 1] and ids[0] != ids[1]
        assert all(one.observations >= 55 for one in estimates[-1])


@pytest.mark.parametrize(("size_m", "joined_steps"), [(15.0, 5), (40.0, 13), (100.0, 31)])
def test_two_fires_whose_segments_join_while_they_cross_stay_two(size_m: float, joined_steps: int) -> None:
    # the near one overtakes the far one in the image at 400 m of flight: 4 px a step at f = 1200
    near = Box(np.array([400.0, 1500.0, 50.0]), (size_m,) * 3)
    far = Box(np.array([400.0, 3000.0, 100.0]), (size_m,) * 3)
    joined = sum(len(detections_from_mask(drawn(pose_at(10.0 * k), near, far), CAMERA)) == 1 for k in range(81))
    assert joined == pytest.approx(joined_steps, abs=2)
    estimates = flown(localizer(), range(86), lambda k, pose: drawn(pose, near, far))
    assert confirmed(estimates) == {1, 2}
    assert told(estimates, TargetState.DISMISSED) == set()
    ids = [nearest_ids(estimates[-1:], fire)[0] for fire in (near, far)]
    assert sorted(ids) == [1, 2]
    assert [set(nearest_ids(estimates[30:], fire)) for fire in (near, far)] == [{one} for one in ids]


@pytest.mark.parametrize(("until", "stay"), [(33, 1), (60, 2)])
def test_parts_that_go_apart_join_again_unless_both_were_confirmed(until: int, stay: int) -> None:
    wide = Box(CUBE_ENU_M, (200.0, 20.0, 60.0))

    def masks(k: int, pose: CameraPose) -> Mask:
        if not 25 <= k < until:
            return drawn(pose, wide)
        apart_m = 95.0  # more than its width together
        halves = [Box(CUBE_ENU_M + np.array([side * apart_m, 0.0, 0.0]), (80.0, 20.0, 60.0)) for side in (-1, 1)]
        return drawn(pose, *halves)

    estimates = flown(localizer(), range(100), masks)
    assert told(estimates[:25], *TargetState) == {1}
    split = {one.id for one in estimates[until - 1]}
    assert 1 in split and len(split) == 2
    assert len(confirmed(estimates[25:until])) == stay
    # the middle jumps by half the width: that is the segment's and not the compass'
    before, *after = (estimates[k][0].ellipse95.semi_major_m for k in (24, 25, 32))
    assert all(0.8 * before < one < 1.5 * before for one in after)
    assert [one.id for one in estimates[-1]] == [1, 2][:stay]
    assert told(estimates, TargetState.DISMISSED) == told(estimates, *TargetState) - {1, 2}.intersection([1, stay])
    assert [one.state for one in estimates[-1]].count(TargetState.CONFIRMED) == 1


def test_a_short_split_spawns_nobody() -> None:
    def masks(k: int, pose: CameraPose) -> Mask:
        mask = drawn(pose, CUBE)
        if 25 <= k < 28:
            middle = int(np.flatnonzero(mask.any(axis=0)).mean())
            mask[:, middle - 2 : middle + 3] = 0
        return mask

    assert told(flown(localizer(), range(60), masks), *TargetState) == {1}


def clutter(mask: Mask, rng: np.random.Generator, count: int = 100) -> Mask:
    for u, v, w, h in zip(
        rng.integers(0, 1860, count),
        rng.integers(0, 1020, count),
        rng.integers(8, 40, count),
        rng.integers(8, 40, count),
        strict=True,
    ):
        rectangle(mask, u, v, w, h)
    return mask


def test_a_flood_of_false_positives_is_bounded_and_confirms_nothing_false() -> None:
    rng = np.random.default_rng(0)
    located = localizer(config=replace(CONFIG, max_targets=8))
    estimates = flown(located, range(20), lambda k, pose: clutter(drawn(pose, CUBE), rng))
    assert len(located._tracker._tracks) <= 8 + 24
    assert all(len(step) <= 8 for step in estimates)
    for step in estimates:
        for one in step:
            assert one.state is not TargetState.CONFIRMED or error_m(one, CUBE) < 300.0
    assert all(finite(one) for step in estimates for one in step)


def test_false_positives_at_the_border_do_not_use_up_the_pool() -> None:
    located = localizer()
    flown(located, range(30), lambda k, pose: rectangle(empty_mask(), 60 * k, 0, 20, 15))
    assert len(confirmed(flown(located, range(30, 60), of_cube))) == 1


def test_one_bad_frame_before_the_camera_turns_does_not_use_up_the_pool() -> None:
    located, flooded = localizer(), empty_mask()
    for i in range(30):
        rectangle(flooded, 200 + 250 * (i % 6), 200 + 140 * (i // 6))
    located.step(turned(pose_at(0.0), np.pi), flooded)
    assert len(confirmed(flown(located, range(1, 40), of_cube))) == 1


def test_no_more_targets_than_allowed() -> None:
    fires = [Box(np.array([x, 2000.0, 100.0])) for x in (-300.0, 0.0, 300.0, 600.0)]
    located = localizer(config=replace(CONFIG, max_targets=2))
    estimates = flown(located, range(40), lambda k, pose: drawn(pose, *fires))
    assert max(len(step) for step in estimates) == 2
    assert len(confirmed(estimates)) == 2
    # one that is given up makes room for another
    flown(located, range(40, 71), lambda k, pose: empty_mask())
    later = flown(located, range(71, 95), lambda k, pose: drawn(pose, *fires[2:]))
    assert confirmed(later) == {3, 4}


def test_what_is_told_of_the_cube() -> None:
    estimates = flown(localizer(config=replace(CONFIG, n_particles=10_000)), range(101), of_cube)
    (one,) = estimates[-1]
    offset_m = CUBE_ENU_M - np.array([1000.0, 0.0, 0.0])
    assert error_m(one, CUBE) < 40.0
    assert ellipse_holds(one.ellipse95, (CUBE_ENU_M - one.position_enu_m)[:2])
    assert one.range_m == pytest.approx(np.linalg.norm(offset_m), rel=0.02)
    assert one.range95_m[0] < one.range_m < one.range95_m[1]
    assert one.bearing_rad == pytest.approx(np.arctan2(*offset_m[:2]) % (2 * np.pi), abs=0.02)
    assert one.extent.width_m == pytest.approx(129.0, abs=8.0)  # 100 m, and a side seen at an angle
    assert one.extent.height_m == pytest.approx(114.0, abs=6.0)
    assert one.region95.semi_major_m - one.ellipse95.semi_major_m == pytest.approx(one.extent.width_m / 2)
    assert one.region95.semi_minor_m - one.ellipse95.semi_minor_m == pytest.approx(one.extent.width_m / 2)
    assert one.region95.azimuth_rad == one.ellipse95.azimuth_rad
    assert one.ellipse95.semi_major_m >= one.ellipse95.semi_minor_m > 0.0
    assert (one.observations, one.misses, one.baseline_m, one.first_seen_s, one.last_seen_s) == (
        101,
        0,
        1000.0,
        0.0,
        100.0,
    )
    assert np.linalg.eigvalsh(one.covariance_enu_m2).min() > 0.0
    assert one.covariance_enu_m2 == pytest.approx(one.covariance_enu_m2.T, abs=1e-3)
    assert (one.aim, one.existence) == ("centre", pytest.approx(13 / 14))
    major_m = [step[0].ellipse95.semi_major_m for step in estimates if step]
    assert major_m[-1] < 0.2 * major_m[0]


def finite(one: TargetEstimate) -> bool:
    numbers = [*one.position_enu_m, *one.covariance_enu_m2.ravel(), *one.range95_m, one.vertical95_m, one.existence]
    numbers += [one.ellipse95.semi_major_m, one.region95.semi_minor_m, one.extent.width_m, one.extent.height_sigma_m]
    return bool(np.isfinite(numbers).all())


def test_every_report_is_finite_and_in_the_order_of_ids() -> None:
    fires = [Box(np.array([x, 1500.0, 0.0]), (40.0, 40.0, 40.0)) for x in (-500.0, 0.0, 500.0)]
    estimates = flown(localizer(), range(30), lambda k, pose: drawn(pose, *fires[: 1 + k // 5]))
    assert all(finite(one) for step in estimates for one in step)
    assert all([one.id for one in step] == sorted(one.id for one in step) for step in estimates)
    assert len(estimates[-1]) == 3


def test_aim_at_the_base_finds_the_foot() -> None:
    tall = Box(np.array([500.0, 2000.0, 200.0]), (40.0, 40.0, 200.0))
    ends = {}
    for aim in ("centre", "base"):
        config = replace(CONFIG, aim=aim)
        ends[aim] = flown(localizer(config=config), range(71), lambda k, pose: drawn(pose, tall))[-1][0]
        assert ends[aim].aim == aim
    apart_m = ends["centre"].position_enu_m[2] - ends["base"].position_enu_m[2]
    # its root is 40 m wide, or up to 57 seen askew: by a third of that the fire is lower than what is seen
    assert apart_m == pytest.approx(100.0 + 16.0, abs=12.0)
    assert abs(ends["base"].position_enu_m[2] - 100.0) < ends["base"].vertical95_m
    assert error_m(ends["base"], Box(np.array([500.0, 2000.0, 100.0]))) < 60.0


def test_steps_after_the_distance_or_the_interval() -> None:
    located = localizer(config=replace(CONFIG, step_interval_s=2.0))

    def at(stamp_s: float, east_m: float) -> list[TargetEstimate]:
        pose = CameraPose(stamp_s, np.array([east_m, 0.0, 0.0]), R_NORTH)
        return located.step(pose, drawn(pose, CUBE))

    for k in range(10):
        (*_, last) = [*at(0.1 * k, 10.0 * k), None][:1]
    assert last is not None and last.observations == 10
    (same,) = at(2.0, 99.9)  # 1.1 s and 9.9 m since
    assert same is last
    (later,) = at(2.9, 99.9)
    assert later.observations == 11
    (further,) = at(3.0, 109.9)
    assert further.observations == 12
    each = localizer(config=replace(CONFIG, step_distance_m=0.0))
    assert [len(each.step(pose_at(0.0), drawn(pose_at(0.0), CUBE))) for _ in range(5)] == [0, 0, 0, 1, 1]
    each = localizer(config=replace(CONFIG, step_interval_s=0.0))
    assert [len(each.step(pose_at(0.0), drawn(pose_at(0.0), CUBE))) for _ in range(5)] == [0, 0, 0, 1, 1]


def test_a_hovering_camera_sees_smoke_go() -> None:
    located = localizer()
    hover = [CameraPose(float(k), np.zeros(3), R_NORTH) for k in range(12)]
    for pose in hover[:6]:
        estimates = located.step(pose, drawn(pose, CUBE))
    assert [one.state for one in estimates] == [TargetState.TENTATIVE]  # a direction, and no range
    gone = [located.step(pose, empty_mask()) for pose in hover[6:]]
    assert gone[4][0].state is TargetState.DISMISSED and gone[5] == []


@pytest.mark.parametrize("heading_deg", [6.0, 15.0])
def test_poses_that_bring_poorer_errors_widen_the_ellipse(heading_deg: float) -> None:
    errors = PoseErrors(float(np.radians(heading_deg)), 0.02, 0.003, 2.0, 600.0)
    ends = []
    for brought in (None, errors):
        located = localizer()
        for k in range(51):
            pose = replace(pose_at(10.0 * k), errors=brought)
            estimates = located.step(pose, drawn(pose, CUBE))
        ends.append(estimates[0].ellipse95)
    assert ends[1].semi_major_m > 1.3 * ends[0].semi_major_m
    assert ends[1].semi_minor_m > 1.3 * ends[0].semi_minor_m


def test_detections_locate_as_the_mask_does() -> None:
    by_mask, by_detections = localizer(), localizer()
    for k in range(30):
        pose = pose_at(10.0 * k)
        mask = rectangle(drawn(pose, CUBE), 100, 100) if k % 3 == 0 else drawn(pose, CUBE)
        one = by_mask.step(pose, mask)
        other = by_detections.step_detections(pose, detections_from_mask(mask, CAMERA))
        assert [each.id for each in one] == [each.id for each in other]
        assert [each.position_enu_m.tolist() for each in one] == [each.position_enu_m.tolist() for each in other]
        assert [each.ellipse95 for each in one] == [each.ellipse95 for each in other]
    assert one[0].state is TargetState.CONFIRMED


def test_points_are_detections_enough() -> None:
    located = localizer()
    for k in range(51):
        pose = pose_at(10.0 * k)
        pixel = CAMERA.project((pose.R_cam_from_enu @ (CUBE_ENU_M - pose.position_enu_m))[:, None])[0][:, 0]
        estimates = located.step_detections(pose, [Detection.from_point(float(pixel[0]), float(pixel[1]), 2.0)])
    assert error_m(estimates[0], CUBE) < 60.0
    assert localizer().step_detections(pose_at(0.0), []) == []


def test_particles_stand_for_the_cloud() -> None:
    located = localizer()
    assert located.particles_enu_m(1) is None
    (one,) = flown(located, range(40), of_cube)[-1]
    points_enu_m = located.particles_enu_m(1)
    assert points_enu_m is not None and points_enu_m.shape[0] == 3
    sigmas_m = np.sqrt(np.diag(one.covariance_enu_m2))
    assert (np.abs(points_enu_m.mean(axis=1) - one.position_enu_m) < 0.1 * sigmas_m).all()
    assert points_enu_m.std(axis=1) == pytest.approx(sigmas_m, rel=0.15)


def test_same_seed_same_answer() -> None:
    one, same, other = (flown(localizer(seed), range(12), of_cube)[-1][0] for seed in (3, 3, 4))
    assert one.position_enu_m.tolist() == same.position_enu_m.tolist()
    assert one.position_enu_m.tolist() != other.position_enu_m.tolist()


def test_a_mask_of_half_size_locates_as_well() -> None:
    def half(k: int, pose: CameraPose) -> Mask:
        return np.asarray(cv2.resize(drawn(pose, CUBE), (960, 540), interpolation=cv2.INTER_NEAREST), np.uint8)

    (one,) = flown(localizer(), range(61), half)[-1]
    assert error_m(one, CUBE) < 60.0


def test_pose_that_is_not_finite_raises() -> None:
    with pytest.raises(ValueError, match="finite"):
        localizer().step(pose_at(np.nan), empty_mask())


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"filter": "other"}, "filter"),
        ({"aim": "top"}, "aim"),
        ({"n_particles": 0}, "n_particles"),
        ({"max_targets": 0}, "max_targets"),
        ({"dismissal_misses": 0}, "dismissal_misses"),
        ({"range_m": (0.0, 100.0)}, "range_m"),
        ({"range_m": (100.0, 100.0)}, "range_m"),
        ({"range_m": (50.0, float("inf"))}, "range_m"),
        ({"range_m": (50.0, float("nan"))}, "range_m"),
        ({"step_distance_m": -1.0}, "step_distance_m"),
        ({"step_interval_s": float("nan")}, "step_interval_s"),
        ({"heading_bias_sigma_rad": -0.1}, "sigmas"),
        ({"tilt_bias_sigma_rad": float("inf")}, "sigmas"),
        ({"pixel_sigma_px": 0.0}, "pixel_sigma_px"),
        ({"pixel_sigma_px": float("inf")}, "pixel_sigma_px"),
        ({"bias_time_constant_s": float("nan")}, "bias_time_constant_s"),
    ],
)
def test_impossible_settings_raise(changes: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        replace(CONFIG, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("n", [1, 2, 100])
def test_few_particles_do_not_raise(n: int) -> None:
    estimates = flown(localizer(config=replace(CONFIG, n_particles=n)), range(20), of_cube)
    assert all(finite(one) for step in estimates for one in step)


def column(pose: CameraPose, top_px: int, bottom_px: int) -> np.ndarray:
    """A column of smoke 40 px wide about the cube's bearing, from so far above to so far below its middle."""
    (u, v), _ = CAMERA.project((pose.R_cam_from_enu @ (CUBE_ENU_M - pose.position_enu_m))[:, None])
    mask = empty_mask()
    mask[round(v[0]) - top_px : round(v[0]) + bottom_px, round(u[0]) - 20 : round(u[0]) + 20] = 255
    return mask


@pytest.mark.parametrize("heights", [(30, 30, 90), (90, 30, 30)], ids=["grows", "shrinks"])
def test_a_segment_that_changes_for_good_keeps_its_target(heights: tuple[int, int, int]) -> None:
    before, top, after = heights
    located = Localizer(CAMERA, CONFIG, rng=np.random.default_rng(3))
    ids: set[int] = set()
    for step in range(90):
        pose = pose_at(10.0 * step)
        for estimate in located.step(pose, column(pose, top, before if step < 30 else after)):
            ids.add(estimate.id)
            if step > 45:
                assert estimate.state is TargetState.CONFIRMED
                assert ellipse_holds(estimate.ellipse95, (CUBE_ENU_M - estimate.position_enu_m)[:2])
    assert ids == {1}


def test_sizes_of_errors_that_jitter_cost_little() -> None:
    majors = []
    for jitter in (0.0, 0.15):
        rng = np.random.default_rng(1)
        located = Localizer(CAMERA, CONFIG, rng=np.random.default_rng(3))
        for east_m in np.arange(0.0, 601.0, 10.0):
            scale = 1.0 + jitter * float(rng.uniform(-1.0, 1.0))
            errors = PoseErrors(scale * 0.006, 0.002, 0.001, 0.05, 600.0)
            pose = replace(pose_at(float(east_m)), errors=errors)
            (*_, last) = located.step(pose, cube_mask(pose)) or [None]
        assert last is not None
        majors.append(last.ellipse95.semi_major_m)
    assert majors[0] <= 1.1 * majors[1] and majors[1] < 2.0 * majors[0]


def test_a_foot_far_above_the_ground_is_not_forced_down_to_it() -> None:
    located = Localizer(CAMERA, LocalizerConfig(n_particles=20_000), rng=np.random.default_rng(3))
    located.set_ground(FlatGround(-50.0, 30.0, slope=0.0))  # the cube's foot is at 150 m
    for east_m in np.arange(0.0, 801.0, 10.0):
        estimates = located.step(pose_at(float(east_m)), cube_mask(pose_at(float(east_m))))
    (estimate,) = estimates
    assert estimate.state is TargetState.CONFIRMED
    assert ellipse_holds(estimate.ellipse95, (CUBE_ENU_M - estimate.position_enu_m)[:2])
    assert np.linalg.norm(estimate.position_enu_m - CUBE_ENU_M) < 120.0


def test_a_clock_that_goes_back_does_not_stop_it() -> None:
    located = Localizer(CAMERA, LocalizerConfig(n_particles=1000), rng=np.random.default_rng(3))
    hovering = replace(pose_at(0.0), stamp_s=1000.0)
    for second in range(10):
        located.step(replace(hovering, stamp_s=1000.0 + second), cube_mask(hovering))
    (before,) = located.step(replace(hovering, stamp_s=1010.0), cube_mask(hovering))
    (after,) = located.step(replace(hovering, stamp_s=5.0), cube_mask(hovering))
    assert after.observations == before.observations + 1


def test_a_new_epoch_of_the_autopilot_widens_what_is_believed_of_its_compass() -> None:
    errors = []
    for tells in (False, True):
        located = Localizer(CAMERA, CONFIG, rng=np.random.default_rng(3))
        for east_m in np.arange(0.0, 501.0, 10.0):
            located.step(pose_at(float(east_m)), cube_mask(pose_at(float(east_m))))
        if tells:
            located.doubt_attitude()
        turn = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(3.0)]))
        ids = set()
        for east_m in np.arange(510.0, 801.0, 10.0):
            true = pose_at(float(east_m))
            wrong = replace(true, R_cam_from_enu=(turn @ true.R_cam_from_enu.T).T)
            estimates = located.step(wrong, cube_mask(true))
            ids |= {estimate.id for estimate in estimates}
        errors.append((len(ids), float(np.linalg.norm(estimates[0].position_enu_m - CUBE_ENU_M))))
    assert errors[1][0] == 1 and errors[1][1] < 60.0
    assert errors[0][0] > 1 or errors[0][1] > errors[1][1]  # untold, the jump makes another target or moves this one


def test_the_ground_under_its_foot_gives_the_range_early() -> None:
    ends = []
    for ground in (None, FlatGround(150.0, 15.0, slope=0.0)):  # the cube's foot is at 150 m, its middle at 200 m
        located = Localizer(CAMERA, LocalizerConfig(n_particles=20_000), rng=np.random.default_rng(3))
        if ground is not None:
            located.set_ground(ground)
        for east_m in np.arange(0.0, 81.0, 10.0):
            (*_, last) = located.step(pose_at(float(east_m)), cube_mask(pose_at(float(east_m)))) or [None]
        assert last is not None
        ends.append(last)
    without, with_ground = ends
    assert with_ground.ellipse95.semi_major_m < without.ellipse95.semi_major_m
    assert np.linalg.norm(with_ground.position_enu_m - CUBE_ENU_M) < 400.0
    assert ellipse_holds(with_ground.ellipse95, (CUBE_ENU_M - with_ground.position_enu_m)[:2])


@pytest.mark.parametrize("legs", [1, 6])
def test_what_the_silhouette_hides_is_in_the_ellipse(legs: int) -> None:
    """Past the face of a near block, which looks one way before and the other after, with poses that are exact."""
    told = LocalizerConfig(
        n_particles=6000, heading_bias_sigma_rad=1e-6, tilt_bias_sigma_rad=1e-6, position_sigma_m=0.1
    )
    near_enu_m = np.array([500.0, 700.0, 200.0])
    located = Localizer(CAMERA, told, rng=np.random.default_rng(3))
    there = np.arange(350.0, 651.0, 10.0)
    for number, east_m in enumerate(np.concatenate([there, there[::-1]] * 3)[: legs * there.size]):
        pose = replace(pose_at(float(east_m)), stamp_s=float(number))
        (*_, last) = located.step(pose, drawn(pose, Box(near_enu_m))) or [None]
    assert last is not None
    offset_m = (near_enu_m - last.position_enu_m)[:2]
    assert np.linalg.norm(offset_m) > 10.0  # more frames do not help
    assert ellipse_holds(last.ellipse95, offset_m)
    assert last.ellipse95.semi_major_m < 100.0


def test_the_error_of_the_aim_goes_with_the_track() -> None:
    """From the first sighting, through what is seen anew, to another track that takes it over."""
    located = Localizer(CAMERA, LocalizerConfig(n_particles=2000, aim="centre"), rng=np.random.default_rng(3))
    for east_m in np.arange(0.0, 201.0, 10.0):
        located.step(pose_at(float(east_m)), cube_mask(pose_at(float(east_m))))
        for track in located._tracker._tracks:
            width_rad = 100.0 / 2000.0
            bank, place = track.filter.bank, track.filter.place
            aims_rad = bank.particles.x[place, 6] * bank.particles.scale[place, 3]
            variance = np.cov(aims_rad, aweights=bank.particles.weights[place]) + bank.P[place, 3, 3]
            # seen askew it is wider than its face, by up to the root of 2
            assert 0.8 < variance / (0.7 * (width_rad / 2.0) ** 2) ** 2 < 4.0
    assert located._tracker._tracks


def test_pieces_of_a_confirmed_target_are_its_whole() -> None:
    """A target whose segment lies in two parts for many frames stays one, in its place."""
    located = Localizer(CAMERA, CONFIG, rng=np.random.default_rng(3))
    ids: set[int] = set()
    for step, east_m in enumerate(np.arange(0.0, 601.0, 10.0)):
        pose = pose_at(float(east_m))
        mask = cube_mask(pose)
        if step > 30:
            columns = np.flatnonzero(mask.any(axis=0))
            mask[:, columns[columns.size // 2 - 4 : columns.size // 2 + 4]] = 0
        estimates = located.step(pose, mask)
        ids |= {one.id for one in estimates}
    assert ids == {1}
    assert np.linalg.norm(estimates[-1].position_enu_m - CUBE_ENU_M) < 20.0  # as if it were whole


def test_a_second_fire_beside_a_whole_one_gets_its_own_track() -> None:
    wide, small = Box(CUBE_ENU_M, (300.0, 60.0, 200.0)), Box(CUBE_ENU_M + np.array([60.0, -250.0, -60.0]), (30.0,) * 3)

    def masks(k: int, pose: CameraPose) -> Mask:
        mask = drawn(pose, wide)
        if k >= 20:
            spot = drawn(pose, small)
            grown = cv2.dilate(spot, np.ones((9, 9), np.uint8))
            mask[grown > 0] = 0
            mask |= spot
        return mask

    estimates = flown(localizer(), range(80), masks)
    assert len(confirmed(estimates[60:])) >= 2


def test_points_without_a_size_are_confirmed() -> None:
    located = localizer()
    states = []
    for k in range(40):
        pose = pose_at(20.0 * k)
        pixels, _ = CAMERA.project((pose.R_cam_from_enu @ (CUBE_ENU_M - pose.position_enu_m))[:, None])
        points = [Detection.from_point(float(pixels[0, 0]), float(pixels[1, 0]), 2.0)]
        states += [one.state for one in located.step_detections(pose, points)]
    assert TargetState.CONFIRMED in states


@pytest.mark.parametrize("n_particles", [4096, 100_000])
def test_weights_that_nearly_vanish_break_nothing(n_particles: int) -> None:
    """The heading jumps as the autopilot begins anew; a track that is promoted then sees it anew without the doubt."""
    target_enu_m, turned_rad = np.array([-661.4, 3730.2, -12.75]), -0.113546
    seen = [(478.11, 382.83, 3.56), (479.42, 384.46, 4.51), (477.28, 387.14, 2.88), (477.09, 385.63, 6.41)]
    located = Localizer(
        Camera(1280, 720, 900.0, 900.0, 640.0, 360.0),
        LocalizerConfig(n_particles=n_particles, max_targets=2, step_distance_m=0.0),
        rng=np.random.default_rng(213),
    )
    tracker, told = located._tracker, 0
    assert isinstance(tracker, Tracker)
    for step in range(12):
        camera_m = np.array([5.0 * step, 0.0, 100.0])
        R_cam_from_enu = R_NORTH @ matrix_from_rotation_vector(np.array([0.0, 0.0, turned_rad if step > 1 else 0.0]))
        if step == 2:
            tracker.doubt_attitude()
        if step < len(seen):
            u, v, size = seen[step]
        else:
            x, y, z = R_NORTH @ (target_enu_m - camera_m)
            u, v = 640.0 + 900.0 * x / z, 360.0 + 900.0 * y / z
        one = Detection(
            np.array([u, v]), np.array([u, v + size / 2]), np.eye(2) * size, size**2, size, size, 1.0, False
        )
        for estimate in tracker.step(CameraPose(float(step), camera_m, R_cam_from_enu, None), None, [one]):
            told += 1
            assert np.isfinite(estimate.position_enu_m).all() and np.isfinite(estimate.covariance_enu_m2).all()
        for track in tracker._tracks:
            particles, place = track.filter.bank.particles, track.filter.place
            assert np.isfinite(particles.weights[place]).all() and np.isfinite(particles.x[place]).all()
            assert particles.weights[place].sum(dtype=np.float64) == pytest.approx(1.0, abs=1e-4)
    assert told > 5


def test_a_promotion_that_fails_costs_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    located = Localizer(CAMERA, LocalizerConfig(n_particles=2000, max_targets=1), rng=np.random.default_rng(3))
    with monkeypatch.context() as broken:
        broken.setattr(Belief, "_see_anew", lambda track: 1 / 0)
        failed = 0
        for east_m in np.arange(0.0, 101.0, 10.0):
            try:
                located.step(pose_at(float(east_m)), cube_mask(pose_at(float(east_m))))
            except ZeroDivisionError:
                failed += 1
        assert failed > 0
    estimates = [located.step(pose_at(float(x)), cube_mask(pose_at(float(x)))) for x in np.arange(110.0, 201.0, 10.0)]
    assert len(estimates[-1]) == 1  # the one place is still there


def test_who_goes_on_with_anothers_filter_takes_its_views_too() -> None:
    located, boxes = localizer(), (CUBE, Box(CUBE.position_enu_m + np.array([400.0, 0.0, 0.0])))
    for k in range(8):
        pose = replace(pose_at(10.0 * k), heading_rad=0.1 * k)
        located.step(pose, drawn(pose, *boxes[: 1 + (k >= 3)]))
    older, younger = located._tracker._tracks  # type: ignore[union-attr]
    rows = younger.belief.views.rows
    assert 0 < len(rows) < len(older.belief.views.rows)
    older.adopt(younger)
    assert older.belief.views.rows.tolist() == rows.tolist()


@pytest.mark.parametrize("aim", ["base", "centre"])
def test_a_hundred_false_segments_hide_no_fire(aim: Literal["base", "centre"]) -> None:
    fire, rng = Box(CUBE_ENU_M, (80.0, 20.0, 160.0)), np.random.default_rng(7)
    flight = flown(
        localizer(config=replace(CONFIG, aim=aim)), range(60), lambda k, pose: clutter(drawn(pose, fire), rng)
    )
    found = [one for one in flight[-1] if one.state is TargetState.CONFIRMED]
    assert [error_m(one, fire) < 0.1 * one.range_m for one in found] == [True]


@pytest.mark.parametrize("aim", ["base", "centre"])
def test_a_mask_that_flickers_between_the_halves_of_a_plume_loses_no_place(aim: Literal["base", "centre"]) -> None:
    halves = [Box(CUBE_ENU_M + np.array([side * 20.0, 0.0, 0.0]), (40.0, 20.0, 160.0)) for side in (-1, 1)]
    flight = flown(localizer(config=replace(CONFIG, aim=aim)), range(60), lambda k, pose: drawn(pose, halves[k % 2]))
    for estimates in flight[20:]:
        assert 1 in {one.id for one in estimates} and len(estimates) <= 2
        assert all(error_m(one, Box(CUBE_ENU_M)) < 0.3 * one.range_m for one in estimates)


@pytest.mark.parametrize("side", [-1, 1])
def test_of_two_that_are_one_the_older_id_goes_on_with_what_the_other_saw(
    side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("distloc.tracks.tracker._MERGED_STEPS", 1)
    monkeypatch.setattr("distloc.tracks.assignment.apart.Apart.are", lambda *_: False)
    monkeypatch.setattr(Tracker, "_are_one_place", lambda *_: True)
    halves = [Box(CUBE_ENU_M + np.array([at * 95.0, 0.0, 0.0]), (80.0, 20.0, 60.0)) for at in (-1, 1)]
    grown = Box(CUBE_ENU_M + np.array([side * 40.0, 0.0, 0.0]), (300.0, 20.0, 60.0))
    seen = {39: halves, 40: []}  # both are missed before
    flight = flown(localizer(), range(43), lambda k, pose: drawn(pose, *seen.get(k, halves if k < 39 else [grown])))
    assert {one.id for one in flight[40]} == {1, 2}
    assert {one.id for one in flight[41] if one.state is not TargetState.DISMISSED} == {1}
    (one,) = flight[42]
    assert one.id == 1 and one.last_seen_s == pytest.approx(pose_at(420.0).stamp_s)


@pytest.mark.parametrize("apart_px", [20, 30, 40])
def test_two_small_puffs_and_then_a_plume_over_both_are_one(apart_px: int) -> None:
    """Both give way to the third track in the same step."""
    camera, fire_enu_m = Camera(1280, 720, 1000.0, 1000.0, 639.5, 359.5), np.array([0.0, 3000.0, 0.0])
    tracker = Localizer(camera, LocalizerConfig(), rng=np.random.default_rng(0))
    for k in range(40):
        place_enu_m = np.array([15.0 * k - 400.0, 0.0, 300.0])
        pose = CameraPose(float(k), place_enu_m, looking_at(place_enu_m, fire_enu_m), heading_rad=np.pi / 2.0)
        mask = np.zeros((720, 1280), np.uint8)  # it is held in the middle
        if k < 6:
            mask[348:361, 634 - apart_px : 645 - apart_px] = mask[348:361, 634 + apart_px : 645 + apart_px] = 1
        elif k >= 8:
            mask[160:361, 580:701] = 1
        estimates = tracker.step(pose, mask)
    assert [one.id for one in estimates] == [1]


@pytest.mark.parametrize("roll_deg", [90.0, 180.0, -90.0])
def test_in_a_picture_that_is_rolled_the_lowest_rows_are_no_foot(roll_deg: float) -> None:
    tall = Box(np.array([600.0, 2000.0, 100.0]), (60.0, 60.0, 200.0))
    roll = matrix_from_rotation_vector(np.array([0.0, 0.0, np.radians(roll_deg)]))

    def rolled(k: int) -> CameraPose:
        pose = pose_at(10.0 * k)
        return replace(pose, R_cam_from_enu=roll @ pose.R_cam_from_enu)

    tracker = localizer(config=replace(CONFIG, aim="base"))
    for k in range(61):
        estimates = tracker.step(rolled(k), drawn(rolled(k), tall))
    (one,) = estimates
    assert one.state is TargetState.CONFIRMED
    foot_enu_m = np.array([600.0, 2000.0, 0.0])
    assert ellipse_holds(one.ellipse95, (foot_enu_m - one.position_enu_m)[:2]) and abs(one.position_enu_m[2]) < 150.0
