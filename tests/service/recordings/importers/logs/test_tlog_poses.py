"""Telemetry logs as sources: the same poses as before, at rates that a replay can use."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from distloc.types import CameraPose
from service.config.load import load_config
from service.recordings.importers.flight import Given, ImportRefusedError
from service.recordings.importers.logs.tlog_poses import read_tlog_poses
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording
from tests.support.flown import angle_deg, imported
from tests.support.places import CUT, DATA


def poses_of(folder: Path, config: Path) -> dict[int, CameraPose]:
    """Of each frame, by its stamp in us."""
    posed = PosedFrames(Recording(folder), load_config(config))
    return {round(frame.stamp_ns / 1000): pose for frame, pose in posed.pairs(lambda stamp_ns: None)}


def test_a_real_autopilots_recording_keeps_its_poses(tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, said = imported(CUT / "telemetry.tlog", "--out", out, "--config", CUT / "config.toml")
    assert code == 0, said
    assert "a log alone" in said
    (out / "frames.csv").write_bytes((CUT / "frames.csv").read_bytes())
    shutil.copytree(CUT / "masks", out / "masks")
    before, after = poses_of(CUT, CUT / "config.toml"), poses_of(out, CUT / "config.toml")
    both = before.keys() & after.keys()
    assert len(both) >= 0.9 * len(before) > 10
    off_deg = [angle_deg(before[one].R_cam_from_enu @ after[one].R_cam_from_enu.T) for one in both]
    step_m = np.array([before[one].position_enu_m - after[one].position_enu_m for one in both])
    assert max(off_deg) < 0.1  # by TIMESYNC both times, before by what had come till then
    assert np.linalg.norm(step_m - np.median(step_m, axis=0), axis=1).max() < 0.3


@pytest.mark.skipif(not DATA.exists(), reason="the real logs are not here")
@pytest.mark.parametrize(("name", "least_s"), [("codelever_1", 350), ("dronekit_flight_replay", 150)])
def test_a_slow_radios_log_has_poses_in_more_seconds_than_before(tmp_path: Path, name: str, least_s: int) -> None:
    from service.config.sections import Config

    source, out = DATA / "telemetry" / f"{name}.tlog", tmp_path / "out"
    code, said = imported(source, "--out", out)
    assert code == 0, said
    assert "attitudes between those told, at 10 a second" in said

    def seconds(folder: Path, config: Config) -> int:
        posed = PosedFrames(Recording(folder), config)
        assert not list(posed.pairs(lambda stamp_ns: None))
        return posed.probes["pose"]

    assert seconds(out, load_config(out / "config.toml")) > max(least_s, seconds(source, Config()))


@pytest.mark.parametrize(("content", "says"), [(b"\xfe" * 5000, "no MAVLink frame with a stamp"), (b"", "is empty")])
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "x.tlog"
    path.write_bytes(content)
    code, said = imported(path, "--out", tmp_path / "out")
    assert (code, says in said, said.strip().count("\n")) == (1, True, 0), said


def test_a_log_of_heartbeats_has_no_pose(tmp_path: Path) -> None:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    mav = mavlink.MAVLink(None, 1, 1)
    frames = [mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(mav) for _ in range(20)]
    path = tmp_path / "x.tlog"
    path.write_bytes(b"".join((1_784_000_000_000_000 + i * 10**6).to_bytes(8, "big") + f for i, f in enumerate(frames)))
    with pytest.raises(ImportRefusedError, match="no pose of an autopilot among them"):
        read_tlog_poses(path, Given())
