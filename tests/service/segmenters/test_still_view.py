"""What has changed in a view that stands still, and the faint segments that it speaks for."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.types import CameraPose
from service.common.messages import Frame
from service.segmenters.still_view import StillView, with_changed

CAMERA = Camera(640, 360, 600.0, 600.0, 319.5, 179.5)
WIDE = cv2.GaussianBlur(np.random.default_rng(5).integers(0, 256, (480, 960, 3), np.uint8), (0, 0), 20.0)
SCENE = cv2.normalize(WIDE, np.empty_like(WIDE), 20, 220, cv2.NORM_MINMAX)[60:420, 160:800]


def frame(at_s: float, image: NDArray[np.uint8]) -> Frame:
    """One of the camera's, as noisy as a camera's are."""
    noise = np.random.default_rng(int(at_s * 10)).normal(0.0, 2.0, image.shape)
    return Frame(int(at_s * 1e9), "x", np.clip(image + noise, 0, 255).astype(np.uint8))


def with_smoke(image: NDArray[np.uint8], height: int) -> NDArray[np.uint8]:
    """Grey over 40 columns."""
    out = image.copy()
    out[200 - height : 200, 300:340] = out[200 - height : 200, 300:340] // 2 + 100
    return out


def pose(heading_deg: float = 0.0, east_m: float = 0.0) -> CameraPose:
    """Of a level camera."""
    a = np.radians(heading_deg)
    R = np.array([[np.cos(a), -np.sin(a), 0.0], [0.0, 0.0, -1.0], [np.sin(a), np.cos(a), 0.0]])
    return CameraPose(0.0, np.array([east_m, 0.0, 0.0]), R)


def test_what_grows_has_changed_and_what_stands_has_not() -> None:
    view = StillView(CAMERA)
    assert view.change(frame(0.0, with_smoke(SCENE, 30)), pose()) is None  # nothing before it
    change = view.change(frame(15.0, with_smoke(SCENE, 110)), pose())
    assert change is not None and change.shape == (45, 80)
    assert change[12:20, 38:42].min() > 1.0  # the 80 rows by which it grew
    assert np.delete(change, range(36, 44), axis=1).max() < 1.0


@pytest.mark.parametrize("turn_deg", [0.5, 3.0, -4.0])
def test_a_camera_that_only_turned_sees_the_same(turn_deg: float) -> None:
    view = StillView(CAMERA)
    view.change(frame(0.0, SCENE), pose())
    R = pose(turn_deg).R_cam_from_enu @ pose().R_cam_from_enu.T
    K = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 179.5], [0.0, 0.0, 1.0]])
    turned = cv2.warpPerspective(SCENE, K @ R @ np.linalg.inv(K), (640, 360))
    change = view.change(frame(15.0, with_smoke(turned, 80)), pose(turn_deg))
    assert change is not None
    assert change[16:24, 38:42].min() > 1.0 and np.quantile(np.delete(change, range(36, 44), axis=1), 0.95) < 1.0


def test_a_camera_that_moves_on_tells_nothing() -> None:
    view = StillView(CAMERA)
    view.change(frame(0.0, SCENE), pose())
    assert view.change(frame(15.0, WIDE[60:420, 200:840]), pose()) is None
    assert view.change(frame(15.2, SCENE), pose(0.0, 40.0)) is None
    assert view.change(frame(15.5, SCENE), pose(180.0)) is None  # it looks elsewhere
    assert view.change(frame(16.0, SCENE), None) is None  # nobody knows how it is turned


def test_a_brighter_sun_is_no_change() -> None:
    view = StillView(CAMERA)
    view.change(frame(0.0, SCENE), None)
    change = view.change(frame(15.0, SCENE + np.uint8(20)), None)
    assert change is not None and change.max() < 1.0


@pytest.mark.parametrize(
    ("later_s", "is_compared"), [(1.0, False), (9.0, False), (11.0, True), (119.0, True), (130.0, False)]
)
def test_frames_between_10_s_and_2_minutes_are_compared(later_s: float, is_compared: bool) -> None:
    view = StillView(CAMERA)
    view.change(frame(100.0, SCENE), None)
    assert (view.change(frame(100.0 + later_s, SCENE), None) is not None) == is_compared


def test_a_clock_that_goes_back_begins_anew() -> None:
    view = StillView(CAMERA)
    view.change(frame(1000.0, SCENE), None)
    assert view.change(frame(100.0, SCENE), None) is None
    assert view.change(frame(115.0, SCENE), None) is not None


def test_only_faint_segments_of_their_own_that_changed_are_added() -> None:
    mask, faint, change = np.zeros((90, 160), np.uint8), np.zeros((90, 160), np.bool_), np.zeros((45, 80), np.float32)
    faint[10:20, 10:20] = faint[10:20, 40:50] = faint[50:70, 100:120] = True
    change[5:10, 5:10] = change[25:35, 50:60] = 2.0
    mask[55:60, 105:110] = 255  # what is sure stays as it is
    added = with_changed(mask, faint, change)
    assert (added[10:20, 10:20] == 255).all() and (added[10:20, 40:50] == 0).all()
    assert np.array_equal(added[50:70, 100:120], mask[50:70, 100:120])
    assert np.array_equal(with_changed(mask, faint, None), mask)
