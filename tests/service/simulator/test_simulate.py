"""A short simulated recording: what is in it, that its seed decides it, and that it never overwrites."""

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.backports import tomllib
from service.config.sections import Config, MountConfig, SegmenterConfig
from service.recordings.recording import Recording
from service.recordings.replay import Replay
from service.recordings.tlog import TlogReader
from service.simulator.scenario import CameraConfig, Scenario, camera_pose, centre_enu_m, load_scenario
from service.simulator.simulate import simulate, stamp_us

SMALL = CameraConfig(
    width=320, height=180, fx=225.0, fy=225.0, cx=159.5, cy=89.5, mount=MountConfig(yaw_deg=-75.0, pitch_deg=-5.0)
)
SHORT: Scenario = msgspec.structs.replace(load_scenario("demo"), camera=SMALL, duration_s=3.0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("simulated") / "flight"
    shares: list[float] = []
    simulate(out, SHORT, 4, shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0
    return out


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_it_reads_as_a_recording(recording: Path) -> None:
    read = Recording(recording)
    frames = read.frames()
    assert [stamp for stamp, _ in frames] == [stamp_us(number / 5.0) for number in range(15)]
    image = read.load_image(frames[0][1])
    assert image is not None and image.shape == (180, 320, 3)
    assert read.truth is not None and len(read.truth.targets) == 1
    assert not read.dropped
    config = msgspec.convert(tomllib.loads((recording / "config.toml").read_text()), Config)
    assert config.camera == SMALL
    assert [path.name for path in recording.parent.iterdir()] == ["flight"]


def test_masks_show_the_plume_where_it_is(recording: Path) -> None:
    centre = centre_enu_m(SHORT.targets[0])
    for number in (0, 14):
        mask = cv2.imread(str(recording / "masks" / f"{number:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert mask is not None and set(np.unique(mask)) == {0, 255}
        pose = camera_pose(SHORT, number / 5.0, 0.0)
        pixel, _ = SMALL.camera().project((pose.R_cam_from_enu @ (centre - pose.position_enu_m))[:, None])
        assert np.hypot(*(np.argwhere(mask)[:, ::-1].mean(axis=0) - pixel[:, 0])) < 8.0


def test_telemetry_holds_both_directions_in_order(recording: Path) -> None:
    reader = TlogReader(recording / "telemetry.tlog")
    parser = mavlink.MAVLink(None)
    stamps, names = [], []
    for stamp, frame in reader:
        (message,) = parser.parse_buffer(frame)
        stamps.append(stamp)
        names.append((message.get_srcComponent(), message.get_type()))
    assert reader.dropped_bytes == 0
    assert stamps == sorted(stamps)
    assert 125 <= names.count((1, "ATTITUDE")) <= 150
    assert 48 <= names.count((1, "GLOBAL_POSITION_INT")) <= 60
    assert names.count((191, "COMMAND_LONG")) == names.count((1, "COMMAND_ACK")) == 6
    assert 25 <= names.count((191, "TIMESYNC")) <= 33
    assert names.count((191, "HEARTBEAT")) == 4


def test_seed_decides_the_bytes(recording: Path, tmp_path: Path) -> None:
    simulate(tmp_path / "same", SHORT, 4, lambda share: None)
    assert contents(tmp_path / "same") == contents(recording)
    simulate(tmp_path / "other", SHORT, 5, lambda share: None)
    other = contents(tmp_path / "other")
    assert other["telemetry.tlog"] != contents(recording)["telemetry.tlog"]
    assert other["truth.json"] == contents(recording)["truth.json"]


def test_it_does_not_overwrite(recording: Path) -> None:
    before = contents(recording)
    with pytest.raises(FileExistsError, match="not an empty folder"):
        simulate(recording, SHORT, 4, lambda share: None)
    assert contents(recording) == before


def test_failure_leaves_nothing(tmp_path: Path) -> None:
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path / "flight", SHORT, 4, stop)
    assert not list(tmp_path.iterdir())


def test_an_empty_folder_is_filled(tmp_path: Path) -> None:
    (tmp_path / "flight").mkdir()
    simulate(tmp_path / "flight", msgspec.structs.replace(SHORT, duration_s=0.4), 4, lambda share: None)
    assert (tmp_path / "flight" / "truth.json").is_file()


def test_a_replay_of_its_pictures_says_what_the_scenery_measured(recording: Path) -> None:
    config = msgspec.convert(tomllib.loads((recording / "config.toml").read_text()), Config)
    config = msgspec.structs.replace(
        config, segmenter=SegmenterConfig(kind="classical")
    )  # so small, the model is blind
    run = Replay(Recording(recording), config, seed=0)
    run.run(lambda line: None, lambda stamp_ns: None)
    said = run.status()["scenery"]
    assert said["state"] in ("scenery", "autopilot") and said["corners"] > 8
    assert said["heading_error_deg"] == -said["error_deg"][2]
    assert all(0.0 < sigma_deg < 10.0 for sigma_deg in said["sigma_deg"])
    assert "no_image" not in said["reasons"]
    explained = run.status()["explain"]
    assert (explained["places"], explained["places_used"]) == (config.localizer.max_targets, len(run.last))
    assert 0 < len(explained["tracks"]) <= 8
