"""A real film of a GoPro Karma: its streams as GoPro's own parser reads them, its clocks, the way to a recording."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from distloc.geometry.rotations import euler_from_quaternion, heading_rad, matrix_from_quaternion
from service.commands.cli import app
from service.recordings.importers.flight import Film, Given
from service.recordings.importers.gopro.mp4_track import payloads, read_track
from service.recordings.importers.gopro.reading import read_gopro
from service.recordings.importers.gopro.series import Series, gathered
from tests.support.places import DATA

KARMA = DATA / "karma" / "karma.mp4"
pytestmark = pytest.mark.skipif(not KARMA.is_file(), reason="no shared data")

# What gpmf-parser (C, by GoPro; py_gpmf_parser 0.1.1) reads of this film: samples, and the first one's first columns.
BY_ITS_MAKER = {
    "GYRO": (4795, [0.04580559, 0.01864181, 0.03328895]),
    "ACCL": (2397, [10.15789474, -0.85167464, -3.70095694]),
    "ATTD": (47, [146.065, -0.0773103312, -0.180359393, -0.496353149, 0.251130402, -1.20019352, -0.110726252]),
    "GLPI": (47, [146.071, 33.1253688, -117.331067, 15.711, 2.003, 0.88, -0.75, -0.08, 331.56]),
    "GPRI": (47, [145.911705, 33.1253680, -117.331064, 15.445, 0.25, 0.42, 0.59, 334.35, 3.0, 20.0]),
    "CYTS": (48, [142.925, 1.0, 0.0, 0.0, 0.0, -0.000226609307, 0.000172133674, -0.0408874005]),
    "SYST": (12, [146.544283, 1492457278.0]),
}


@pytest.fixture(scope="module")
def series() -> dict[str, Series]:
    track = read_track(KARMA)
    return gathered(payloads(KARMA, track), track.times_s, frozenset(BY_ITS_MAKER))[0]


@pytest.mark.parametrize("key", BY_ITS_MAKER)
def test_the_streams_are_as_their_makers_parser_reads_them(series: dict[str, Series], key: str) -> None:
    count, first = BY_ITS_MAKER[key]
    assert len(series[key].values) == count
    assert series[key].values[0, : len(first)] == pytest.approx(first, rel=1e-6, abs=1e-8)


def test_the_autopilots_clock_is_tied_by_when_its_samples_came(series: dict[str, Series]) -> None:
    """Its stamps are 145.8 s ahead of the film less 0.2 to 0.6 s on the way, as other means found as well."""
    for key, offset_s in (("ATTD", -145.83), ("GLPI", -145.84), ("CYTS", -142.8)):
        found_s, half_s = series[key].clock_tie(series[key].values[:, 0])
        assert found_s == pytest.approx(offset_s, abs=0.15), key
        assert 0.0 <= half_s < 0.15, key


def test_the_gimbals_turn_added_to_the_crafts_heading_stands_still(series: dict[str, Series]) -> None:
    """It is what `karma.py` takes CYTS for: the craft sways by 1.5 degrees, the camera's heading does not."""
    craft, turn = series["ATTD"], series["CYTS"]
    craft_s, turn_s = (one.values[:, 0] + one.clock_tie(one.values[:, 0])[0] for one in (craft, turn))
    yaw = np.degrees(craft.values[:, 3])
    camera = yaw + np.degrees(np.interp(craft_s, turn_s, turn.values[:, 7]))
    settled = craft_s > 3.0
    assert yaw[settled].std() > 0.2
    assert camera[settled].std() < 0.15


def test_the_flight_is_what_its_telemetry_says() -> None:
    flight = read_gopro(KARMA, Given())
    assert flight.craft is not None and flight.gimbal is not None and flight.positions is not None
    assert flight.epoch_s == pytest.approx(1_492_457_277.3, abs=1.0)  # 2017-04-17T19:27:57Z
    assert (len(flight.craft.time_s), len(flight.positions.time_s), len(flight.gimbal.attitudes.time_s)) == (47, 47, 48)
    yaw, pitch, roll = np.degrees(euler_from_quaternion(flight.craft.q_ned_from_body[0]))
    assert (yaw, pitch, roll) == (
        pytest.approx(-28.439, abs=0.01),
        pytest.approx(-10.334, abs=0.01),
        pytest.approx(-4.43, abs=0.01),
    )
    assert flight.positions.alt_msl_m[0] == pytest.approx(15.711)
    assert flight.positions.above_home_m[0] == pytest.approx(2.003)
    assert np.hypot(*flight.positions.velocity_ned_mps[-1, :2]) > 5.0
    assert flight.fixes is not None and set(flight.fixes.satellites.tolist()) <= set(range(15, 25))
    assert isinstance(flight.frames, Film) and len(flight.frames.time_s) == 362
    assert not flight.frames_tied and flight.tied_within_s == 0.6
    level = [matrix_from_quaternion(q) for q in flight.gimbal.attitudes.q_ned_from_body]
    assert max(abs(R[2, 0]) + abs(R[2, 1]) for R in level) < 1e-9
    assert max(abs((np.degrees(heading_rad(R)) + 180.0) % 360.0 - 180.0) for R in level) < 3.0


def test_one_command_makes_a_recording_that_replays(tmp_path: Path) -> None:
    out, played = tmp_path / "recording", tmp_path / "played"
    said = CliRunner().invoke(app, ["import", str(KARMA), "--out", str(out), "--hfov", "84.9"])
    assert said.exit_code == 0, said.output
    assert "on one clock within 0.6 s" in said.output  # the gimbal hardly turns, and that is said
    config = (out / "config.toml").read_text(encoding="utf-8")
    assert "gimbal = true" in config
    tilt = re.search(r"^tilt_bias_deg = ([0-9.]+)", config, re.MULTILINE)
    assert tilt and 3.0 < float(tilt[1]) < 3.5  # the gimbal turns little in that time
    small = '\n[segmenter]\nkind = "classical"\n'
    (out / "config.toml").write_text(config + small, encoding="utf-8")
    replayed = CliRunner().invoke(app, ["replay", str(out), "--out", str(played)])
    assert replayed.exit_code == 0, replayed.output
    used = re.search(r"(\d+) of 362 frames used", replayed.output)
    assert used is not None and 343 <= int(used[1]) <= 362, replayed.output
