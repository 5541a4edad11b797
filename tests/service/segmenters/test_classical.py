import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.renderer import Plume, Renderer
from distloc.types import CameraPose, RejectReason
from service.common.messages import Frame
from service.segmenters.classical import ClassicalSegmenter
from service.segmenters.horizon_by_eye import HorizonFinder
from service.segmenters.level_view import ALL_LAND, HorizonLine, level_view
from tests.support.places import DATA

CAMERA = Camera(1280, 720, 900.0, 900.0, 640.0, 360.0)
BENT = Camera(1280, 720, 900.0, 900.0, 640.0, 360.0, (-0.2, 0.05, 0.0, 0.0))
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no frames beside the repository")


def pose(roll_deg: float, pitch_deg: float) -> CameraPose:
    attitude = matrix_from_euler(0.03, np.radians(pitch_deg), np.radians(roll_deg))
    return CameraPose(60.0, np.array([0.0, 0.0, 120.0]), R_cam_from_enu(attitude, np.eye(3)))


def landscape(width: int, height: int, slope: float, middle: float) -> NDArray[np.uint8]:
    """Bright sky over dark land with texture; the line falls by `slope` rightwards and is at `middle` in the middle."""
    rng = np.random.default_rng(1)
    u, v = np.arange(width) - 0.5 * (width - 1), np.arange(height)
    is_land = v[:, None] > middle + slope * u[None, :]
    light = np.where(is_land, 70.0, 190.0) + np.where(is_land, 25.0, 3.0) * rng.normal(size=(height, width))
    return np.asarray(np.clip(light, 0.0, 255.0), dtype=np.uint8)


@pytest.mark.parametrize("tilt_deg", [-40.0, -20.0, 0.0, 10.0, 30.0, 45.0])
@pytest.mark.parametrize("middle", [100.0, 135.0, 190.0])
def test_a_tilted_horizon_is_found_by_eye(tilt_deg: float, middle: float) -> None:
    image = landscape(480, 270, np.tan(np.radians(tilt_deg)), middle)
    line = HorizonFinder(480, 270).find(image)
    assert line is not None and np.degrees(line.angle_rad) == pytest.approx(tilt_deg, abs=3.1)
    assert 480.0 * line.offset == pytest.approx((middle - 134.5) * np.cos(np.radians(tilt_deg)), abs=8.0)


def test_no_horizon_is_seen_in_the_ground_or_upside_down() -> None:
    finder = HorizonFinder(480, 270)
    assert finder.find(landscape(480, 270, 0.0, -1.0)) is None
    assert finder.find(np.full((270, 480), 90, np.uint8)) is None
    assert finder.find(np.ascontiguousarray(landscape(480, 270, 0.1, 135.0)[::-1])) is None


@pytest.mark.parametrize("camera", [CAMERA, BENT])
@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0.0, -5.0), (35.0, -3.0), (-70.0, 2.0), (180.0, 0.0)])
def test_a_poses_line_is_where_the_horizon_projects(camera: Camera, roll_deg: float, pitch_deg: float) -> None:
    where = pose(roll_deg, pitch_deg)
    azimuth = np.radians(np.linspace(-20.0, 20.0, 9)) + 0.03
    far = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(9)])
    (u, v), is_seen = camera.project(where.R_cam_from_enu @ far)
    line = ClassicalSegmenter(camera, 0.3)._line(where)
    across, down = np.sin(line.angle_rad), np.cos(line.angle_rad)
    below = down * (v - 359.5) - across * (u - 639.5) - 1280.0 * line.offset
    assert is_seen.sum() >= 5 and np.abs(below[is_seen]).max() < 6.0


@pytest.mark.parametrize("line", [HorizonLine(0.0, 0.1), HorizonLine(0.7, -0.05), HorizonLine(-2.5, 0.0), ALL_LAND])
def test_a_mask_comes_back_from_the_level_view(line: HorizonLine) -> None:
    mask = np.zeros((270, 480), np.uint8)
    cv2.ellipse(mask, (100, 200), (40, 20), 30.0, 0.0, 360.0, 255, -1)
    view = level_view(mask, line, 20)
    assert not view.is_inside[:, [0, -1]].any()
    back = view.frame_from_view(np.where(view.light > 127, 255, 0).astype(np.uint8))
    assert np.count_nonzero(back != mask) < 0.06 * np.count_nonzero(mask)


@pytest.mark.parametrize("roll_deg", [-40.0, 35.0])
def test_rendered_smoke_is_found_in_a_turn(roll_deg: float) -> None:
    where = pose(roll_deg, -5.0)
    plume = Plume(np.array([0.0, 2000.0, 0.0]), 160.0, 120.0, np.array([2.0, 0.0, 0.0]))
    image, truth = Renderer(CAMERA, [plume], np.random.default_rng(2)).render(where)
    mask = ClassicalSegmenter(CAMERA, 0.3).segment(Frame(0, "a", image), where)
    assert not isinstance(mask, RejectReason)
    full = cv2.resize(mask, (1280, 720), interpolation=cv2.INTER_NEAREST) > 0
    assert (full & (truth > 0)).sum() > 0.4 * (full | (truth > 0)).sum()


@pytest.mark.parametrize("pitch_deg", [-90.0, -60.0, 60.0, 90.0])
def test_ground_alone_and_sky_alone_are_no_smoke(pitch_deg: float) -> None:
    where = pose(0.0, pitch_deg)
    image, _ = Renderer(CAMERA, [], np.random.default_rng(3)).render(where)
    mask = ClassicalSegmenter(CAMERA, 0.3).segment(Frame(0, "a", image), where)
    assert not isinstance(mask, RejectReason) and not mask.any()


def test_a_near_plume_without_a_horizon_is_smoke_and_a_bright_road_is_not() -> None:
    image = cv2.cvtColor(landscape(480, 270, 0.0, -1.0), cv2.COLOR_GRAY2BGR)
    cv2.line(image, (0, 200), (479, 215), (220, 220, 220), 8)
    segmenter = ClassicalSegmenter(Camera(480, 270, 400.0, 400.0, 239.5, 134.5), 0.4)
    road = segmenter.segment(Frame(0, "a", image), None)
    assert not isinstance(road, RejectReason) and not road.any()
    truth = cv2.ellipse(np.zeros((270, 480), np.uint8), (250, 80), (130, 75), 0.0, 0.0, 360.0, 255, -1)
    image[truth > 0] = 225
    mask = segmenter.segment(Frame(0, "a", image), None)
    assert not isinstance(mask, RejectReason)
    assert ((mask > 0) & (truth > 0)).sum() > 0.9 * ((mask > 0) | (truth > 0)).sum()


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


def segments(path: Path) -> tuple[NDArray[np.float64], int, int]:
    """Centroids (N, 2) of a frame's segments, in its pixels, and the frame's width and height."""
    image = np.asarray(cv2.imread(str(path)), dtype=np.uint8)
    height, width = image.shape[:2]
    camera = Camera(width, height, 0.8 * width, 0.8 * width, 0.5 * width, 0.5 * height)
    mask = ClassicalSegmenter(camera, 0.3).segment(Frame(0, path.name, image), None)
    assert not isinstance(mask, RejectReason), path.name
    _, _, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return centroids[1:][stats[1:, cv2.CC_STAT_AREA] >= 12] * width / mask.shape[1], width, height


@needs_data
def test_real_drone_plumes_are_found() -> None:
    folder = DATA / "smoke_boreal_uav"
    found = []
    for row in table(folder / "boxes.csv"):
        centroids, width, height = segments(folder / "images" / f"{row['image']}.jpg")
        from_middle = np.abs(centroids / (width, height) - (float(row["cx"]), float(row["cy"])))
        found.append(bool((from_middle <= (0.5 * float(row["w"]), 0.5 * float(row["h"]))).all(axis=1).any()))
    assert sum(found[:5]) >= 4


@needs_data
def test_real_distant_smoke_is_found_in_a_third_of_the_frames() -> None:
    folder = DATA / "smoke_hpwren_smokeseg"
    found = []
    for path in sorted((folder / "images").glob("*.jpg")):
        truth = np.asarray(cv2.imread(str(folder / "masks" / f"{path.stem}.png"), cv2.IMREAD_GRAYSCALE))
        away_px = cv2.distanceTransform(np.where(truth > 0, 0, 1).astype(np.uint8), cv2.DIST_L2, 5)
        centroids = np.round(segments(path)[0]).astype(int)
        found.append(bool((away_px[centroids[:, 1], centroids[:, 0]] <= 10.0).any()))
    assert len(found) == 19 and sum(found) >= 7


@needs_data
def test_real_frames_without_smoke_rarely_show_any() -> None:
    paths = sorted((DATA / "negatives_horizon_uav" / "images").glob("*.jpg"))
    paths.append(DATA / "smoke_boreal_uav" / "images" / "genuine_false_alarm_bright_sky.jpg")
    assert sum(len(segments(path)[0]) for path in paths) <= 0.3 * len(paths)


@needs_data
def test_real_tilted_horizons_are_found_by_eye() -> None:
    folder = DATA / "negatives_horizon_uav"
    errors = []
    for row in table(folder / "label.csv"):
        path = folder / "images" / row["filename"]
        if path.is_file():
            image = np.asarray(cv2.imread(str(path)), dtype=np.uint8)
            line = HorizonFinder(image.shape[1], image.shape[0]).find(image.min(axis=2))
            assert line is not None
            slope, offset = float(row["slope"]), float(row["offset"])  # of the frame's sides, which are alike
            middle = offset + 0.5 * slope - 0.5
            errors.append((line.angle_rad - np.arctan(slope), line.offset - middle * np.cos(np.arctan(slope))))
    assert len(errors) == 29
    assert np.degrees(np.abs(errors)[:, 0]).max() < 5.0 and np.median(np.abs(errors), axis=0)[1] < 0.04
