"""The model that ships: its card is of the file, and it finds smoke where smoke was drawn or photographed."""

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from distloc.sights.detections import detections_from_mask
from distloc.simulation.renderer import Renderer
from service.commands.study.segmentation.run import run_segmentation
from service.common.messages import Frame
from service.config.sections import SegmenterConfig
from service.segmenters.model_session import ModelSession
from service.segmenters.segment import make_segmenter, shipped_model
from service.simulator.scenario import camera_pose, load_scenario, plumes
from tests.support.places import DATA

CPU = ("CPUExecutionProvider",)
SHIPPED = SegmenterConfig(kind="onnx", providers=CPU)


def test_the_card_is_of_this_file() -> None:
    path = shipped_model()
    card = path.with_suffix(".md").read_text()
    assert hashlib.sha256(path.read_bytes()).hexdigest() in card
    assert path.stat().st_size < 4_000_000
    stated = re.search(r"[Vv]ersion (\S+),", card)
    session = ModelSession(path, CPU)
    assert stated is not None and session.metadata["distloc.version"] == stated[1]
    for word in ("Licence", "cross-validated", "Limits"):
        assert word in card


@pytest.mark.parametrize("t_s", [1.0, 15.0, 30.0])
def test_a_rendered_plume_is_found_in_its_place(t_s: float) -> None:
    scenario = load_scenario("demo")
    camera = scenario.camera.camera()
    image, truth = Renderer(camera, plumes(scenario), np.random.default_rng(5)).render(camera_pose(scenario, t_s, t_s))
    mask = make_segmenter(SHIPPED, camera).segment(Frame(0, "0", image), None)
    assert isinstance(mask, np.ndarray)
    (found,) = detections_from_mask(mask, camera)
    (drawn,) = detections_from_mask(truth, camera)
    assert np.linalg.norm(found.centre_px - drawn.centre_px) < 8.0  # of 1280


def test_nothing_is_found_where_nothing_burns() -> None:
    scenario = load_scenario("demo")
    camera = scenario.camera.camera()
    segmenter = make_segmenter(SHIPPED, camera)
    for seed in range(4):
        image, _ = Renderer(camera, [], np.random.default_rng(seed)).render(camera_pose(scenario, 5.0 * seed, 0.0))
        mask = segmenter.segment(Frame(0, "0", image), None)
        assert isinstance(mask, np.ndarray)
        assert not detections_from_mask(mask, camera)


@pytest.mark.skipif(not (DATA / "smoke_boreal_uav").is_dir(), reason="no shared data")
def test_it_does_on_real_frames_at_least_what_its_card_says(tmp_path: Path) -> None:
    """The shipped network was fitted to these frames too, so this guards the file and the way it is run, no more."""
    folders = [DATA / name for name in ("smoke_hpwren_smokeseg", "smoke_boreal_uav", "negatives_horizon_uav")]
    run_segmentation(folders, "onnx", None, tmp_path, lambda line: None)
    found = json.loads((tmp_path / "segmentation.json").read_text())
    boreal = next(one for one in found["folders"] if one["folder"] == "smoke_boreal_uav")
    assert boreal["found_share"] == 1.0
    assert found["false_per_negative"] <= 0.3
    assert found["found_share"] >= 0.5  # 12 of 24
