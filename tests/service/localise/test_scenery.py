"""Corners of the scenery through the localise stage: what they tell, and what must not keep a frame from its mask."""

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.scenery.compass import Compass, CompassState
from distloc.scenery.corners import Corners
from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import Autopilot
from service.common.messages import Frame
from service.config.load import load_config
from service.config.sections import CameraConfig, Config, LocaliserSection, MavlinkConfig, MountConfig, SceneryConfig
from service.localise.scenery import HELD_S, FollowedScenery, Lacking, NoScenery, SceneryState
from service.localise.stage import Localised, LocaliseStage
from service.recordings.recording import Recording
from service.recordings.replay import Replay
from tests.support.ground_pictures import GroundPictures, flown
from tests.support.places import CUT

CAMERA = CameraConfig(width=480, height=270, fx=400.0, fy=400.0, cx=239.5, cy=134.5)
NO_SMOKE = np.zeros((270, 480), np.uint8)
PERIOD_S = 0.25
PICTURES = GroundPictures(CAMERA.camera())


class NoSmoke:
    """A segmenter that sees none; or says why there is no mask."""

    name = "none"

    def __init__(self, camera: CameraConfig) -> None:
        self.mask: NDArray[np.uint8] | RejectReason = np.zeros((camera.height, camera.width), np.uint8)

    def segment(self, frame: Frame, pose: CameraPose | None) -> NDArray[np.uint8] | RejectReason:
        return self.mask


class Flight:
    """A stage that frames are taken through; `corners` are those that the last one had."""

    def __init__(self, camera: CameraConfig = CAMERA, **scenery: Any) -> None:
        self.segmenter = NoSmoke(camera)
        config = Config(camera=camera, localizer=LocaliserSection(n_particles=200), scenery=SceneryConfig(**scenery))
        self.stage = LocaliseStage(config, self.segmenter, Autopilot(MavlinkConfig(), MountConfig()))
        self.corners: Corners | None = None
        track = self.stage.scenery.track

        def seen(*arguments: Any) -> Corners | None:
            self.corners = track(*arguments)
            return self.corners

        self.stage.scenery.track = seen  # type: ignore[method-assign]

    def take(self, image: NDArray[Any] | None, pose: CameraPose) -> Localised:
        return self.stage.process(Frame(round(pose.stamp_s * 1e9), "frame", image), pose)

    def fly(self, seconds: tuple[float, float], error_deg: float = 0.0, pictures: GroundPictures = PICTURES) -> None:
        for t_s in np.arange(*seconds, PERIOD_S):
            self.take(pictures.at(flown(t_s)), flown(t_s, error_deg))

    @property
    def names(self) -> set[int]:
        return set() if self.corners is None else set(self.corners.names.tolist())

    @property
    def lacking(self) -> dict[Lacking, int]:
        assert isinstance(self.stage.scenery, FollowedScenery)
        return dict(self.stage.scenery.lacking)

    @property
    def state(self) -> SceneryState:
        return self.stage.scenery.state


@pytest.mark.parametrize("error_deg", [3.2, -3.2])
def test_a_compass_that_reads_too_much_has_a_plus(error_deg: float) -> None:
    flight = Flight()
    flight.fly((0.0, 26.0), error_deg)
    state = flight.state
    assert state.heading_error_rad is not None and state.sigma_rad is not None
    found_deg, sigma_deg = math.degrees(state.heading_error_rad), math.degrees(state.sigma_rad[2])
    assert found_deg == pytest.approx(error_deg, abs=min(0.6, 4.0 * sigma_deg))
    assert 0.0 < sigma_deg < 0.6
    assert (state.source, state.is_off, state.is_bad) == ("scenery", True, False)
    assert flight.lacking == {}
    localised = flight.take(PICTURES.at(flown(26.0)), flown(26.0, error_deg))
    assert localised.best_pose is not None
    for pose, off_deg in ((localised.pose, error_deg), (localised.best_pose, 0.0)):
        turned = pose.R_cam_from_enu.T @ flown(26.0).R_cam_from_enu
        assert math.degrees(math.atan2(turned[0, 1], turned[0, 0])) == pytest.approx(off_deg, abs=0.6)


def test_a_true_compass_is_not_off_and_a_very_wrong_one_is_bad() -> None:
    true, wrong = Flight(), Flight()
    true.fly((0.0, 20.0))
    wrong.fly((0.0, 30.0), 14.0)
    assert (true.state.is_off, true.state.is_bad) == (False, False)
    assert (wrong.state.is_off, wrong.state.is_bad) == (True, True)


def test_a_heading_that_jumps_is_known_to_be_off_by_the_jump_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight()
    jumped_ns = 12_000_000_000
    monkeypatch.setattr(
        flight.stage._autopilot, "heading_turned_rad", lambda stamp_ns: math.radians(8.0 * (stamp_ns >= jumped_ns))
    )
    flight.fly((0.0, 12.0), -2.0)
    flight.fly((12.0, 12.1), 6.0)
    state = flight.state
    assert state.stamp_s == 12.0 and state.error_rad is not None and state.sigma_rad is not None
    assert math.degrees(-state.error_rad[2]) == pytest.approx(6.0, abs=1.0)
    assert math.degrees(state.sigma_rad[2]) < 1.0


def test_without_pictures_all_is_as_without_the_scenery(tmp_path: Path) -> None:
    copy = Path(shutil.copytree(CUT, tmp_path / "copy"))
    config = load_config(copy / "config.toml")
    config = msgspec.structs.replace(config, localizer=msgspec.structs.replace(config.localizer, n_particles=100))
    told: list[list[bytes]] = []
    for is_enabled in (True, False):
        of_one = msgspec.structs.replace(config, scenery=SceneryConfig(enabled=is_enabled))
        reports: list[bytes] = []
        run = Replay(Recording(copy), of_one, seed=0)
        run.run(reports.append, lambda stamp_ns: None)
        told.append(reports)
        said = run.status()["scenery"]
        assert said["state"] == ("autopilot" if is_enabled else "off")
        assert set(said["reasons"]) == ({"no_image"} if is_enabled else set())
        assert (said["error_deg"], said["heading_error_deg"], said["sigma_deg"]) == (None, None, None)
    assert told[0] == told[1] and len(told[0]) > 20


@pytest.mark.parametrize(
    ("spoilt", "reason"),
    [
        (PICTURES.at(flown(2.0))[:, :, :2].copy(), Lacking.TRACKER_FAILED),  # two channels
        (PICTURES.at(flown(2.0)).astype(np.float64), Lacking.TRACKER_FAILED),
        (PICTURES.at(flown(2.0))[:, :300], Lacking.FRAME_SIZE),
        (PICTURES.at(flown(2.0))[:0], Lacking.FRAME_SIZE),
        (None, Lacking.NO_IMAGE),
    ],
)
def test_a_picture_that_fails_the_tracker_costs_its_corners_alone(spoilt: NDArray[Any] | None, reason: Lacking) -> None:
    flight = Flight()
    flight.fly((0.0, 2.0))
    localised = flight.take(spoilt, flown(2.0))
    assert (flight.corners, flight.lacking) == (None, {reason: 1})
    assert localised.mask is not None and localised.reason is None
    frames = flight.stage.frames
    flight.fly((2.25, 3.0))
    assert flight.stage.frames == frames + 3
    assert len(flight.names) > 20 and flight.lacking == {reason: 1}
    assert flight.state.reasons[str(reason)] == 1


def test_corners_keep_their_names_over_short_hops_and_lose_them_where_time_is_broken() -> None:
    flight = Flight()
    flight.fly((0.0, 1.0))
    before = flight.names
    flight.fly((1.0, 1.5))
    assert len(before & flight.names) > 10
    for t_s in (4.0, 3.0, 3.25, 5.5):  # a gap, back, on, another gap
        before = flight.names
        flight.fly((t_s, t_s + 0.1))
        assert len(flight.names) > 20
        assert bool(before & flight.names) is (t_s == 3.25)
    before = flight.names
    flight.take(PICTURES.at(flown(6.0)), flown(5.5))
    broken = {Lacking.FRAME_GAP: 2, Lacking.STAMP_BACK: 1, Lacking.REPEATED_STAMP: 1}
    assert (flight.corners, flight.lacking) == (None, broken)
    flight.fly((5.75, 5.8))
    assert before & flight.names


def test_a_camera_that_changes_to_a_fraction_of_its_size_begins_anew_and_is_less_exact() -> None:
    flight = Flight()
    flight.fly((0.0, 1.0))
    before, sigma_px = flight.names, flight.corners.sigma_px.min() if flight.corners else 0.0
    small = cv2.resize(PICTURES.at(flown(1.0)), (240, 135), interpolation=cv2.INTER_AREA)
    flight.take(np.asarray(small, np.uint8), flown(1.0))
    assert flight.corners is not None and len(flight.names) > 20
    assert not before & flight.names and flight.lacking == {Lacking.SIZE_CHANGED: 1}
    assert flight.corners.sigma_px.min() == pytest.approx(2.0 * sigma_px, rel=0.2)


def test_no_corner_lies_in_the_smoke_or_in_the_last_one_where_there_is_no_mask() -> None:
    flight = Flight()
    smoke = NO_SMOKE.copy()
    smoke[100:200, 150:300] = 255
    flight.segmenter.mask = smoke
    for t_s in (0.0, 0.25, 0.5, 0.75):
        if t_s == 0.5:
            flight.segmenter.mask = RejectReason.SEGMENTATION_FLOODED
        flight.fly((t_s, t_s + 0.1))
        assert flight.corners is not None and len(flight.names) > 10
        u, v = flight.corners.pixels.round().astype(int)
        assert not smoke[v, u].any()
    assert flight.stage.frames == 2


def test_no_corner_lies_in_the_crafts_own_parts() -> None:
    flight = Flight(own_parts=(((0.0, 100.0), (479.0, 100.0), (479.0, 200.0), (0.0, 200.0)),))
    flight.fly((0.0, 2.0))
    assert flight.corners is not None and len(flight.names) > 10
    v = flight.corners.pixels[1]
    assert not ((v > 100.0) & (v < 200.0)).any()


def test_switched_off_it_says_so_and_follows_nothing() -> None:
    flight = Flight(enabled=False)
    flight.fly((0.0, 1.0))
    assert isinstance(flight.stage.scenery, NoScenery)
    assert (flight.corners, flight.state.source, flight.state.at(1e9).source) == (None, "off", "off")
    assert flight.stage.localizer.compass.state is None
    pose = flown(0.0)
    assert flight.state.corrected(pose) is pose


def test_the_configs_numbers_arrive() -> None:
    flight = Flight(corners=12, window=7)
    flight.fly((0.0, 1.0))
    assert len(flight.names) == 12
    assert flight.stage.localizer.compass._window.size == 7


@pytest.mark.parametrize(
    ("model", "distortion"),
    [("fisheye", (0.05, -0.01, 0.0, 0.0)), ("brown-conrady", (-0.28, 0.07, 0.0, 0.0)), ("brown-conrady", (-0.5,) * 4)],
)
def test_a_lens_that_bends_is_handled(model: Any, distortion: tuple[float, ...]) -> None:
    """The last one can't be inverted towards the border: such corners are left out."""
    camera = msgspec.structs.replace(CAMERA, fx=300.0, fy=300.0, model=model, distortion=distortion)
    pictures = GroundPictures(camera.camera())
    flight = Flight(camera)
    flight.fly((0.0, 8.0), 3.0, pictures)
    assert flight.lacking == {}
    assert flight.state.error_rad is not None and flight.state.sigma_rad is not None
    if distortion != (-0.5,) * 4:
        off_deg = math.degrees(abs(-flight.state.error_rad[2] - math.radians(3.0)))
        assert off_deg < 4.0 * math.degrees(flight.state.sigma_rad[2])


@pytest.mark.parametrize("size", [(16, 16), (16, 270), (4000, 16)])
def test_a_camera_of_any_size_is_taken(size: tuple[int, int]) -> None:
    camera = CameraConfig(width=size[0], height=size[1], hfov_deg=60.0)
    flight = Flight(camera)
    pictures = GroundPictures(camera.camera())
    flight.fly((0.0, 1.0), 0.0, pictures)
    assert flight.stage.frames == 4
    assert flight.lacking == {}


def test_a_pose_that_is_not_finite_leaves_nothing_behind() -> None:
    flight = Flight()
    flight.fly((0.0, 1.0))
    spoilt = replace(flown(1.0), position_enu_m=np.array([np.nan, 0.0, 80.0]))
    with pytest.raises(ValueError, match="finite"):
        flight.take(PICTURES.at(flown(1.0)), spoilt)
    flight.fly((1.25, 4.0))
    assert len(flight.names) > 20
    assert flight.state.error_rad is not None and np.isfinite(flight.state.error_rad).all()


def test_a_mask_that_is_made_later_counts_for_its_frame_and_for_those_to_come() -> None:
    scenery = FollowedScenery(CAMERA.camera(), 48)
    smoke = np.zeros_like(NO_SMOKE)
    smoke[:, 240:] = 255
    found = [scenery.follow(Frame(0, str(t_s), PICTURES.at(flown(t_s))), flown(t_s)) for t_s in (0.0, 0.25, 0.5)]
    assert all(one is not None and (one.pixels[0] > 240.0).sum() > 5 for one in found)
    frame = Frame(0, "0.25", None)
    assert scenery.outside(frame, found[1], RejectReason.SEGMENTATION_FLOODED) is found[1]
    for corners in (
        scenery.outside(frame, found[1], smoke),
        scenery.follow(Frame(0, "0.75", PICTURES.at(flown(0.75))), flown(0.75)),
    ):
        assert corners is not None and corners.names.size > 5 and (corners.pixels[0] < 240.0).all()
    assert scenery.outside(frame, None, smoke) is None
    assert scenery.outside(frame, found[1], np.zeros((0, 0), np.uint8)) is found[1]
    assert scenery.lacking == {}


def noted(scenery: FollowedScenery, compass: Compass, stamp_s: float, error_deg: float) -> SceneryState:
    error_rad = np.radians([0.0, 0.0, -error_deg])
    compass.state = CompassState(error_rad, np.eye(3) * np.radians(0.3) ** 2, 30, 0, stamp_s, 0.0, 0.02)
    scenery.note(compass)
    return scenery.state


def test_what_holds_for_ten_seconds_to_one_side_is_off() -> None:
    scenery, compass = FollowedScenery(CAMERA.camera(), 8), Compass(CAMERA.camera())
    for t_s in range(10):
        assert not noted(scenery, compass, t_s, 12.0).is_off
    state = noted(scenery, compass, 10.0, 12.0)
    assert (state.is_off, state.is_bad) == (True, True)
    assert (noted(scenery, compass, 11.0, 9.0).is_off, scenery.state.is_bad) == (True, False)
    assert not noted(scenery, compass, 12.0, -9.0).is_off
    assert noted(scenery, compass, 12.0 + HELD_S, -9.0).is_off
    assert not noted(scenery, compass, 60.0, -9.0).is_off  # nobody knows what was between
    assert not noted(scenery, compass, 69.0, 1.0).is_off
    compass.state = None
    scenery.note(compass)
    assert (scenery.state.error_rad, scenery.state.off_s) == (None, 0.0)


def test_what_was_measured_long_ago_is_not_told() -> None:
    scenery, compass = FollowedScenery(CAMERA.camera(), 8), Compass(CAMERA.camera())
    noted(scenery, compass, 0.0, 12.0)
    state = noted(scenery, compass, 10.0, 12.0)
    assert state.at(19.0) is state
    later = state.at(21.0)
    assert (later.source, later.heading_error_rad, later.is_off, later.is_bad) == ("autopilot", None, False, False)
    assert state.at(5.0).error_rad is None


def test_what_is_not_finite_is_not_told() -> None:
    scenery, compass = FollowedScenery(CAMERA.camera(), 8), Compass(CAMERA.camera())
    assert noted(scenery, compass, 0.0, math.nan).error_rad is None
