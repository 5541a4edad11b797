"""Times to alert and false alarms by hand: the counts are the tracker's, at one place of a camera that stands still."""

import math

import numpy as np
import pytest

from distloc.geometry.camera import Camera
from distloc.study.alerts.names import FrameName, frame_name
from distloc.study.alerts.places import FixedCamera
from distloc.study.alerts.plots import alerts_figure
from distloc.study.alerts.summary import pooled
from distloc.study.alerts.watch import SequenceWatch, Watched
from distloc.study.segmentation import truth_from_mask
from distloc.types import BoolArray, Detection, RejectReason

CAMERA = Camera(512, 384, 500.0, 500.0, 255.5, 191.5)
SMOKE, ELSEWHERE = (100, 100), (300, 300)  # row and column of a block's corner


def block(*corners: tuple[int, int]) -> BoolArray:
    """A mask with squares of 20 pixels."""
    mask = np.zeros((384, 512), np.bool_)
    for row, column in corners:
        mask[row : row + 20, column : column + 20] = True
    return mask


def at(u_px: float, v_px: float, size_px: float = 20.0) -> Detection:
    middle = np.array([u_px, v_px])
    return Detection(middle, middle, np.eye(2), size_px**2, size_px, size_px, 1.0)


def watched(after: str, before: str = "", period_s: float = 60.0, *, has_truth: bool = True) -> Watched:
    """A letter a frame: s smoke at its place, e elsewhere, b both, . none; what is before ends at the ignition."""
    shown = {"s": block(SMOKE), "e": block(ELSEWHERE), "b": block(SMOKE, ELSEWHERE), ".": block()}
    watch = SequenceWatch(CAMERA)
    for number, letter in enumerate(before):
        watch.frame(period_s * (number + 1 - len(before)), shown[letter], None, False)
    truth = truth_from_mask(block(SMOKE)) if has_truth else None
    for number, letter in enumerate(after, start=1):
        watch.frame(period_s * number, shown[letter], truth, has_truth)
    return watch.watched()


@pytest.mark.parametrize(
    ("after", "expected_s"),
    [
        ("ssssssssssss", (60, 240, 480)),
        ("..ssssssssss", (180, 360, 600)),
        ("s.s.ss.ss.ss.", (60, 360, 720)),  # 4 of frames 1 to 6; 8 of frames 1 to 12
        ("s...ss...ss...", (60, math.nan, math.nan)),
        ("ssss.....ssss", (60, 240, math.nan)),  # five misses end what was told of
        ("ssss....sssss", (60, 240, 720)),
        ("eeeeeeeeeeee", (math.nan, math.nan, math.nan)),
        ("", (math.nan, math.nan, math.nan)),
    ],
)
def test_when_a_level_is_reached(after: str, expected_s: tuple[float, ...]) -> None:
    assert watched(after).after_s == pytest.approx(expected_s, nan_ok=True)


def test_false_alarms_before_the_ignition_are_counted_once_a_level() -> None:
    one = watched("ssss", before="eeeeeeeeee...bbbb..")  # e goes on over 3 misses: it was told of
    assert one.false == (2, 2, 1) and one.hours == pytest.approx(18 / 60) and one.frames == (19, 4)
    assert one.after_s == pytest.approx((60.0, 240.0, math.nan), nan_ok=True)  # nothing before counts for the fire
    assert watched("", before="e" * 61).hours == pytest.approx(1.0)
    assert watched("", before="eeee", period_s=601.0).hours == 0.0


def test_where_the_truth_is_unknown_a_place_that_was_there_before_is_no_fire() -> None:
    assert np.isnan(watched("eeee", before="e", has_truth=False).after_s).all()
    assert watched("eebb", before="e", has_truth=False).after_s[0] == 180.0
    assert watched("ssss", has_truth=False).after_s[:2] == (60.0, 240.0)


def test_a_refusal_is_a_frame_without_segments() -> None:
    watch = SequenceWatch(CAMERA)
    watch.frame(0.0, RejectReason.SEGMENTATION_FLOODED, None, True)
    watch.frame(60.0, RejectReason.SEGMENTATION_FLOODED, truth_from_mask(block(SMOKE)), True)
    assert watch.watched().frames == (1, 1) and np.isnan(watch.watched().after_s).all()


def test_a_place_follows_what_drifts_and_takes_one_segment() -> None:
    camera = FixedCamera(512)
    for step in range(8):
        (seen,) = camera.step([at(100.0 + 25.0 * step, 50.0)])  # boxes touch, or nearly
    assert seen.place.level == 2
    first, second = camera.step([at(290.0, 50.0), at(280.0, 50.0)])
    assert second.place is seen.place and first.place is not seen.place and first.has_risen
    (far,) = FixedCamera(512).step([at(400.0, 50.0)])
    assert far.has_risen


def test_places_do_not_grow_without_bound() -> None:
    camera = FixedCamera(100_000)
    for step in range(4):
        camera.step([at(3000.0 * n, 3000.0 * step, 4.0) for n in range(96)])
    assert len(camera._places) == 256


def test_names() -> None:
    stem = "20160604_FIRE_rm-n-mobo-c__1465065660_+00060"
    assert frame_name(stem) == FrameName("20160604_FIRE_rm-n-mobo-c", 1465065660, 60)
    assert frame_name("1465063200_-02400") == FrameName("", 1465063200, -2400)
    for other in ("frame_000123", "20160604_FIRE", "a_1465065660", "a__1465065660_00060", "a__1465065660_+00060_b"):
        assert frame_name(other) is None


def test_pooled_by_hand() -> None:
    none = math.nan
    ones = [
        Watched((60.0, 240.0, none), (3, 1, 0), 0.5, (31, 20)),
        Watched((120.0, none, none), (0, 0, 0), 0.25, (16, 20)),
        Watched((none, none, none), (1, 0, 0), 0.0, (0, 20)),
        Watched((none, none, none), (2, 0, 0), 1.25, (76, 0)),  # it never lit
    ]
    found = pooled(0.5, ones)
    assert (found.fires, found.hours, found.told, found.false) == (3, 2.0, (2, 1, 0), (6, 1, 0))
    assert found.after_s == pytest.approx((120.0, none, none), nan_ok=True)
    assert found.false_per_hour == (3.0, 0.5, 0.0)
    nothing = pooled(None, [Watched((none,) * 3, (0, 0, 0), 0.0, (0, 0))])
    assert nothing.fires == 0 and np.isnan(nothing.after_s).all() and np.isnan(nothing.false_per_hour).all()


def test_a_picture_of_whatever_there_is() -> None:
    never = Watched((math.nan,) * 3, (0, 0, 0), 0.0, (0, 3))
    for curve in ([pooled(0.5, [never])], [pooled(None, [])]):
        assert len(alerts_figure(curve, "a").axes) == 3
    with pytest.raises(ValueError, match="at least one threshold"):
        alerts_figure([], "a")
