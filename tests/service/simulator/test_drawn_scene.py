"""What a scenario's camera draws: its landscape, and its faults in each of the simulated cameras."""

import cv2
import msgspec
import numpy as np
import pytest

from distloc.simulation.renderer import Renderer
from service.config.sections import CameraConfig
from service.simulator.drawn_scene import DrawnScene
from service.simulator.scenario import FaultSection, Scenario, camera_pose, load_scenario, plumes
from service.simulator.spoilable_camera import SpoilableCamera

SMALL = CameraConfig(
    width=320, height=180, fx=225.0, fy=225.0, cx=160.0, cy=90.0, mount=load_scenario("demo").camera.mount
)
FLAT: Scenario = msgspec.structs.replace(load_scenario("two_fires"), camera=SMALL)


def drawn(scenario: Scenario, seed: int = 1) -> DrawnScene:
    return DrawnScene(scenario, np.random.default_rng(seed))


def test_flat_without_faults_is_what_the_renderer_draws() -> None:
    renderer = Renderer(SMALL.camera(), plumes(FLAT), np.random.default_rng(1))
    image, mask = renderer.render(camera_pose(FLAT, 3.0, 3.0))
    again, its_mask = drawn(FLAT).at(3.0)
    assert np.array_equal(image, again) and np.array_equal(mask, its_mask)
    assert np.array_equal(drawn(FLAT).seen_at(3.0), image)


def test_the_smoke_of_a_flat_scene_with_faults_is_where_it_is_without() -> None:
    faulty = msgspec.structs.replace(FLAT, camera_faults=FaultSection(exposure_ms=4.0))
    assert np.array_equal(drawn(faulty).at(3.0)[1], drawn(FLAT).at(3.0)[1])


@pytest.mark.parametrize("landscape", ["flat", "hills"])
def test_jpeg_is_the_scenarios_or_the_cameras_own(landscape: str) -> None:
    plain = msgspec.structs.replace(FLAT, landscape=landscape)
    coarse = msgspec.structs.replace(plain, camera_faults=FaultSection(jpeg_quality=20))
    image = drawn(plain).at(2.0)[0]
    assert np.array_equal(drawn(coarse).at(2.0)[0], image)
    seen = drawn(coarse).seen_at(2.0)
    sent = cv2.imdecode(np.frombuffer(drawn(coarse).jpeg(image, 92), np.uint8), cv2.IMREAD_COLOR)
    assert np.array_equal(seen, sent) and not np.array_equal(seen, image)
    assert len(drawn(plain).jpeg(image, 92)) > 2 * len(drawn(coarse).jpeg(image, 92))


def test_a_rolling_shutter_follows_the_flight() -> None:
    turning = msgspec.structs.replace(FLAT, landscape="hills", path=load_scenario("patrol").path)
    rolling = msgspec.structs.replace(turning, camera_faults=FaultSection(readout_ms=100.0))
    still, sheared = (drawn(one).at(4.0)[0].astype(int) for one in (turning, rolling))
    apart = np.abs(still - sheared).mean(axis=(1, 2))
    assert apart[175:].mean() > 2.0 * apart[88:93].mean()  # the middle row's moment is the frame's


def test_the_soaks_camera_draws_the_landscape() -> None:
    hills = msgspec.structs.replace(FLAT, landscape="hills")
    flat, hilly = (SpoilableCamera(one, 0, seed=5, shrink=2).picture(2_000_000_000) for one in (FLAT, hills))
    assert flat is not None and hilly is not None
    assert flat.shape == hilly.shape == (180, 320, 3) and not np.array_equal(flat, hilly)
