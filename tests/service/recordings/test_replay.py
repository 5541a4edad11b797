"""The replay of a recording: the same bytes twice, a score, and the use of what is left of a damaged one."""

import json
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from service.config.load import load_config
from service.config.sections import Config, GroundConfig, MountConfig
from service.recordings.recording import Recording
from service.recordings.replay import replay
from service.recordings.tlog import read_tlog
from tests.support.places import CUT


def settings() -> Config:
    config = load_config(CUT / "config.toml")
    return msgspec.structs.replace(config, localizer=msgspec.structs.replace(config.localizer, n_particles=5000))


def run(recording: Path, out: Path) -> dict[str, Any]:
    """The status of a replay."""
    replay(Recording(recording), settings(), out, seed=3)
    status: dict[str, Any] = json.loads((out / "status.json").read_bytes())
    return status


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return Path(shutil.copytree(CUT, tmp_path / "copy"))


def test_same_bytes_and_a_good_score(tmp_path: Path) -> None:
    for name in ("one", "two"):
        run(CUT, tmp_path / name)
    names = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert names == ["reports.jsonl", "score.json", "status.json", "targets.geojson"]
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    score = json.loads((tmp_path / "one" / "score.json").read_bytes())
    (fire,) = score["targets"]
    assert fire["state"] == "confirmed"
    assert fire["error_m"] < 0.1 * fire["range_m"]
    assert score["false_confirmed"] == 0


def test_a_gimbal_that_is_lacking_or_doubtful_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    camera = msgspec.structs.replace(settings().camera, mount=MountConfig(gimbal=True))
    config = msgspec.structs.replace(settings(), camera=camera)
    replay(Recording(CUT), config, tmp_path, seed=3)
    status = json.loads((tmp_path / "status.json").read_bytes())
    assert status["frames"]["localised"] == 0 and status["frames"]["rejected"]["gimbal_unknown"] > 10
    assert status["autopilot"]["gimbal"]["fault"] == "no attitude of a gimbal at 2 Hz or more"
    assert "gimbal: no attitude of a gimbal at 2 Hz or more" in caplog.text


def test_log_cut_in_mid_frame(tmp_path: Path, copy: Path) -> None:
    tlog = copy / "telemetry.tlog"
    tlog.write_bytes(tlog.read_bytes()[:200_013])
    status = run(copy, tmp_path / "out")
    assert status["telemetry"]["frames"] > 4000
    assert status["telemetry"]["dropped_bytes"] > 0
    assert status["frames"]["rejected"]["stale_pose"] > 0
    assert (tmp_path / "out" / "reports.jsonl").read_bytes()


def test_missing_masks_and_bad_rows_are_counted(tmp_path: Path, copy: Path) -> None:
    masks = sorted((copy / "masks").iterdir())[20:30]
    for mask in masks[:7]:
        mask.unlink()
    for mask in masks[7:]:
        mask.write_bytes(b"no picture")
    with (copy / "frames.csv").open("a") as file:
        file.write("junk\n-1,00014\n5,../../etc/passwd\n")
    frames = run(copy, tmp_path / "out")["frames"]
    assert frames["rejected"]["frame_missing"] == 7
    assert frames["rejected"]["bad_frame"] == 3
    assert frames["dropped_from_recording"] == {"bad_name": 1, "bad_stamp": 1, "short_row": 1}


def test_null_island_is_never_reported(tmp_path: Path, copy: Path) -> None:
    parser, lines = mavlink.MAVLink(None), []
    for stamp_us, frame in read_tlog(CUT / "telemetry.tlog"):
        message = parser.parse_char(frame)
        if message is not None and message.get_type() == "GLOBAL_POSITION_INT":
            message.lat = message.lon = 0
            sender = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
            sender.seq = message.get_seq()
            lines.append(stamp_us.to_bytes(8, "big") + message.pack(sender))
        else:
            lines.append(stamp_us.to_bytes(8, "big") + frame)
    (copy / "telemetry.tlog").write_bytes(b"".join(lines))
    status = run(copy, tmp_path / "out")
    assert status["autopilot"]["rejects"]["position_invalid"] > 1000
    assert (tmp_path / "out" / "reports.jsonl").read_bytes() == b""
    assert status["frames"]["localised"] == 0


def with_ground(tmp_path: Path, name: str, **ground: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """The status of a replay with a prior from the ground, and the first report's properties."""
    config = msgspec.structs.replace(settings(), ground=GroundConfig(**ground))
    replay(Recording(CUT), config, tmp_path / name, seed=3)
    first = json.loads((tmp_path / name / "reports.jsonl").read_bytes().splitlines()[0])
    return json.loads((tmp_path / name / "status.json").read_bytes()), first["properties"]


def test_flat_ground_shortens_the_first_ellipse(tmp_path: Path) -> None:
    off, far = with_ground(tmp_path, "off")
    assert off["ground"] == {"asked": "off", "used": "none", "reasons": {}}
    flat, near = with_ground(tmp_path, "flat", kind="flat")
    assert flat["ground"] == {"asked": "flat", "used": "flat", "reasons": {}}
    assert near["ellipse95"]["semi_major_m"] < 0.7 * far["ellipse95"]["semi_major_m"]
    assert flat["frames"] == off["frames"]


def test_dem_that_lacks_the_place_is_counted_and_flown_on_flat(tmp_path: Path) -> None:
    dem = tmp_path / "dem"
    dem.mkdir()
    (dem / "N47E008.hgt").write_bytes(bytes(2 * 1201 * 1201))
    status, first = with_ground(tmp_path, "out", kind="dem", path=str(dem))
    assert status["ground"] == {"asked": "dem", "used": "flat", "reasons": {"dem_lacks_place": 1}}
    assert status["frames"]["localised"] > 100
    assert status["targets"] == 1
    _, flat = with_ground(tmp_path, "flat", kind="flat")
    assert first["ellipse95"] == flat["ellipse95"]
