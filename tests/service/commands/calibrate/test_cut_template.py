"""`calibrate --cut-template`: the piece as it is in the frame, and what is refused."""

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from distloc.backports import tomllib
from service.commands.calibrate.cut_template import cut_template
from service.commands.errors import OutputError
from service.config.load import load_config
from service.recordings.recording import Recording, RecordingError
from service.simulator.scenario import Scenario
from service.simulator.simulate import simulate
from tests.service.commands.calibrate.test_by_scenery import SCENE
from tests.service.commands.calibrate.test_calibrate import calibrate
from tests.support.places import CUT

SHORT: Scenario = msgspec.structs.replace(SCENE, duration_s=2.0)
PLACE = (47.4, 8.6, 500.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("cut") / "flight"
    simulate(made, SHORT, 5, lambda share: None)
    return made


def test_the_piece_is_that_of_the_frame_and_the_lines_are_the_configs(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "barn.png"
    done = calibrate(folder, PLACE, "--cut-template", str(out), "--at", "200", "150.4", "--frame", "3", "--side", "21")
    assert done.returncode == 0, done.stderr
    recording = Recording(folder)
    image = recording.load_image(recording.frames()[3][1])
    assert image is not None
    np.testing.assert_array_equal(cv2.imread(str(out)), image[140:161, 190:211])
    (said,) = tomllib.loads(done.stdout)["landmarks"]
    assert said == {"name": "barn", "lat": 47.4, "lon": 8.6, "alt_m": 500.0, "template": "barn.png"}
    text = (folder / "config.toml").read_text(encoding="utf-8")
    (tmp_path / "config.toml").write_text(text + done.stdout, encoding="utf-8")
    assert [one.name for one in load_config(tmp_path / "config.toml").landmarks] == ["barn"]


@pytest.mark.parametrize(
    ("at_px", "frame", "side_px", "says"),
    [
        ((200.0, 150.0), 99, 21, "--frame is 99: there are"),
        ((3.0, 150.0), 0, 21, "21 x 21 pixels about 3 150 reach out of the frame of 480 x 270"),
        ((float("nan"), float("nan")), 0, 21, "21 x 21 pixels about nan nan reach out"),
        ((float("inf"), 3.0), 0, 21, "21 x 21 pixels about inf 3 reach out"),
        ((1e300, 3.0), 0, 21, r"21 x 21 pixels about 1e\+300 3 reach out"),
        ((200.0, 150.0), 0, 201, "the piece that was cut, .* 201 x 201 pixels: at most half of the frame's 480 x 270"),
    ],
)
def test_what_is_no_piece_of_a_frame_is_refused(
    folder: Path, tmp_path: Path, at_px: tuple[float, float], frame: int, side_px: int, says: str
) -> None:
    out = tmp_path / "barn.png"
    with pytest.raises(RecordingError, match=says):
        cut_template(Recording(folder), None, out, at_px, frame, side_px, PLACE, lambda line: None)
    assert not out.exists()
    out.write_text("kept")
    with pytest.raises(RecordingError, match=says):
        cut_template(Recording(folder), None, out, at_px, frame, side_px, PLACE, lambda line: None)
    assert [path.name for path in tmp_path.iterdir()] == ["barn.png"] and out.read_text() == "kept"


@pytest.mark.parametrize(
    ("name", "alt_m", "says"),
    [
        ("my mast.png", 500.0, r"--cut-template .*my mast.png .* landmarks\[0\].name is 'my mast': expected"),
        ("mast.png", 20_000.0, r"mast.png with that --landmark: .* landmarks\[0\].alt_m is 20000.0: expected"),
        ("gone/mast.png", 500.0, "--cut-template .*gone/mast.png: must be a file in a folder .*: No such file"),
        (".", 500.0, "--cut-template .*: must be a file in a folder that can be written: Is a directory"),
    ],
)
def test_what_cannot_be_written_or_would_be_refused_is_one_line(
    folder: Path, tmp_path: Path, name: str, alt_m: float, says: str
) -> None:
    said: list[str] = []
    out, place = tmp_path / name, (47.4, 8.6, alt_m)
    with pytest.raises(OutputError, match=says) as refused:
        cut_template(Recording(folder), None, out, (200.0, 150.0), 0, 21, None if name == "." else place, said.append)
    assert "\n" not in str(refused.value)
    assert list(tmp_path.iterdir()) == [] and said == []


def test_without_a_place_no_lines_are_said_and_any_name_will_do(folder: Path, tmp_path: Path) -> None:
    said: list[str] = []
    cut_template(Recording(folder), None, tmp_path / "my mast.png", (200.0, 150.0), 0, 21, None, said.append)
    assert (tmp_path / "my mast.png").exists() and len(said) == 1 and said[0].startswith("# wrote")


def test_a_recording_without_pictures_and_frames_of_another_size_are_refused(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "barn.png"
    with pytest.raises(RecordingError, match="frame 0 has no picture"):
        cut_template(Recording(CUT), None, out, (200.0, 150.0), 0, 21, None, lambda line: None)
    larger = tmp_path / "larger.toml"
    larger.write_text("[camera]\nwidth = 960\nheight = 540\nhfov_deg = 70.0\n", encoding="utf-8")
    with pytest.raises(RecordingError, match="is 480 x 270 pixels, the camera 960 x 540"):
        cut_template(Recording(folder), larger, out, (200.0, 150.0), 0, 21, None, lambda line: None)


def test_the_options_need_each_other(folder: Path) -> None:
    done = calibrate(folder, None, "--at", "200", "150")
    assert done.returncode == 2 and "--cut-template and --at need each other" in done.stderr
