"""The config's landmarks through the localise stage: found in drawn frames, counted, told; a wrong one is told once."""

import logging
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from distloc.geometry.geodesy import LocalFrame
from distloc.scenery.aided import Aided
from distloc.types import FloatArray
from service.autopilot.autopilot import Autopilot
from service.common.messages import Frame
from service.config.landmarks import LandmarkConfig
from service.config.sections import Config, LocaliserSection, MavlinkConfig, MountConfig
from service.localise.landmark_watch import MISFIT
from service.localise.scenery import FollowedScenery
from service.localise.stage import LocaliseStage
from tests.service.localise.test_scenery import CAMERA, PERIOD_S, PICTURES, NoSmoke
from tests.support.ground_pictures import board, flown, put_board

ORIGIN = LocalFrame(47.4, 8.6, 400.0)
BOARD, SIDE_M = np.array([190.0, 330.0, 8.0]), 18.0
ERROR_DEG = 3.2


class Placed(Autopilot):
    """An autopilot whose map's axes are known."""

    frame_enu = ORIGIN  # type: ignore[assignment]


def stage(folder: Path, off_m: FloatArray) -> LocaliseStage:
    """One with a landmark that is told to be off from where the board stands."""
    path = folder / "board.png"
    cv2.imwrite(str(path), cv2.resize(board(), (29, 29), interpolation=cv2.INTER_AREA))
    lat, lon, alt_m = ORIGIN.geodetic_from_enu(BOARD + off_m)
    landmark = LandmarkConfig(name="board", lat=lat, lon=lon, alt_m=alt_m, template=str(path))
    config = Config(camera=CAMERA, localizer=LocaliserSection(n_particles=200), landmarks=(landmark,))
    return LocaliseStage(config, NoSmoke(CAMERA), Placed(MavlinkConfig(), MountConfig()))


def fly(flying: LocaliseStage, end_s: float, is_drawn: bool = True) -> list[str]:
    """What the state said of the landmark after each frame."""
    states = []
    for t_s in np.arange(0.0, end_s, PERIOD_S):
        image = PICTURES.at(flown(t_s))
        if is_drawn:
            put_board(image, CAMERA.camera(), flown(t_s), BOARD, SIDE_M)
        flying.process(Frame(round(t_s * 1e9), "frame", image), flown(t_s, ERROR_DEG))
        states.append(flying.scenery.state.landmarks["board"])
    return states


def test_a_landmark_is_used_once_it_agrees(tmp_path: Path) -> None:
    flying = stage(tmp_path, np.zeros(3))
    states, state = fly(flying, 30.0), flying.scenery.state
    assert "used" in states and "misfit" not in states
    assert MISFIT not in state.reasons
    assert state.heading_error_rad is not None
    assert math.degrees(state.heading_error_rad) == pytest.approx(ERROR_DEG, abs=0.5)


def test_one_at_a_wrong_place_never_counts_and_is_told_once(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    flying = stage(tmp_path, np.array([0.0, 25.0, 0.0]))
    with caplog.at_level(logging.WARNING):
        states = fly(flying, 30.0)
    assert "used" not in states and "misfit" in states
    assert flying.scenery.state.reasons[MISFIT] > 10
    assert len([line for line in caplog.messages if "landmark 'board' was found" in line]) == 1
    heading_rad = flying.scenery.state.heading_error_rad
    assert heading_rad is not None and math.degrees(heading_rad) == pytest.approx(ERROR_DEG, abs=0.6)


def test_one_that_is_not_there_is_unseen_and_changes_nothing(tmp_path: Path) -> None:
    flying = stage(tmp_path, np.zeros(3))
    assert set(fly(flying, 6.0, is_drawn=False)) == {"unseen"}
    without = stage(tmp_path, np.array([0.0, 0.0, 5000.0]))
    fly(without, 6.0, is_drawn=False)
    for one, other in zip((flying, without), (without, flying), strict=True):
        error = one.scenery.state.error_rad
        assert error is not None
        np.testing.assert_array_equal(error, other.scenery.state.error_rad)


def test_one_in_the_smoke_of_its_own_frame_is_handed_on_in_no_flight_and_no_replay(tmp_path: Path) -> None:
    """In flight the mask comes after the corners were followed."""
    told = {}
    for is_flight in (True, False):
        scenery = stage(tmp_path, np.zeros(3)).scenery
        assert isinstance(scenery, FollowedScenery)
        known = []
        for number in range(5):
            pose = flown(6.0 + 0.25 * number)
            frame = Frame(round(pose.stamp_s * 1e9), str(number), PICTURES.at(pose))
            put_board(np.asarray(frame.image), CAMERA.camera(), pose, BOARD, SIDE_M)
            mask = np.full((CAMERA.height, CAMERA.width), 255 * (number == 4), np.uint8)
            if is_flight:
                corners = scenery.outside(frame, scenery.follow(frame, pose), mask)
            else:
                corners = scenery.track(frame, pose, mask)
            assert corners is not None
            known.append(corners.known.names.tolist())
        told[is_flight] = known
    assert told[True] == told[False] and told[True][4] == [] and [0] in told[True][:4]


def test_without_pictures_it_is_unseen(tmp_path: Path) -> None:
    flying = stage(tmp_path, np.zeros(3))
    flying.process(Frame(0, "frame", None), flown(0.0))
    assert flying.scenery.state.landmarks == {"board": "unseen"}
    assert flying.scenery.state.reasons == {"no_image": 1}


def test_one_that_contradicts_the_corners_is_searched_for_while_it_is_followed(tmp_path: Path) -> None:
    """A look-alike of half the size stood beside it: what the compass says of that reaches the finder."""
    for contradicting, is_found in ((0, False), (1, True)):
        scenery = stage(tmp_path, np.zeros(3)).scenery
        assert isinstance(scenery, FollowedScenery)
        watched, aided = scenery._landmarks, Aided(np.ones((1, 3)))
        for t_s in (7.0, 7.5, 8.0):
            image, pose = PICTURES.at(flown(t_s)), flown(t_s)
            put_board(image, CAMERA.camera(), pose, BOARD + np.array([0.0, -16.0, 0.0]), SIDE_M / 1.9)
            if t_s == 8.0:
                put_board(image, CAMERA.camera(), pose, BOARD, SIDE_M)
            found = watched.find(image, pose, math.radians(1.5), None)
            aided.contradicting[:] = contradicting
            assert watched.note(aided) == {
                "board": ("found", "misfit")[contradicting] if found.names.size else "unseen"
            }
        true_px, _ = CAMERA.camera().project(pose.R_cam_from_enu @ (BOARD - pose.position_enu_m)[:, None])
        near = found.pixels[:, np.linalg.norm(found.pixels - true_px, axis=0) < 1.0]
        assert bool(near.size) is is_found
