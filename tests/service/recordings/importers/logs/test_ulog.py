"""PX4's logs to recordings: what the code that flies makes of them, and what is said of poor ones."""

import sys
from pathlib import Path

import numpy as np
import pytest
from pyulog import ULog

from service.recordings.importers.flight import Given, ImportRefusedError
from service.recordings.importers.logs.ulog import read_ulog
from tests.support.flown import EPOCH_S, HOME_ALT_M, PICTURES_S, UNDULATION_M, Flown, imported, replayed, write_pictures
from tests.support.ulog import BOOT_S, write_ulog

CAMERA = ("--hfov", 60)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_ulog(tmp_path_factory.mktemp("log") / "log.ulg", Flown())


def test_another_reader_finds_what_the_writer_wrote(log: Path) -> None:
    there = {data.name: data.data for data in ULog(str(log)).data_list}
    assert len(there["vehicle_attitude"]["q[0]"]) == 1000 and len(there["sensor_gps"]["timestamp"]) == 100
    assert there["vehicle_global_position"]["lat"][0] == pytest.approx(47.4275)


def test_poses_of_the_recording_are_the_logs(log: Path, tmp_path: Path) -> None:
    code, said = imported(log, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 0, said
    errors = replayed(tmp_path / "out")
    assert errors.frames == len(PICTURES_S)
    # attitudes as told, to half a stamp of 1 ms; places of 1 cm, velocities of 1 cm/s, half a stamp at 10 m/s
    assert 0.0 < errors.attitude_deg < 0.01
    assert 0.0 < errors.position_m < 0.03


def test_what_the_log_tells_is_there(log: Path) -> None:
    flight = read_ulog(log, Given())
    assert flight.epoch_s == pytest.approx(EPOCH_S - BOOT_S, abs=1e-4)
    assert flight.craft is not None and flight.craft.rate_rps[10] == pytest.approx([0.01, 0.02, 0.03])
    assert flight.fixes is not None and (flight.fixes.fix_type == 3).all() and flight.fixes.satellites[0] == 21
    assert flight.fixes.h_acc_m[0] == pytest.approx(0.8) and flight.fixes.v_acc_m[0] == pytest.approx(1.1)
    assert flight.positions is not None
    undulation_m = flight.positions.alt_ellipsoid_m - flight.positions.alt_msl_m
    assert undulation_m[7] == pytest.approx(UNDULATION_M, abs=1e-3)
    assert flight.home is not None and flight.home[2] == pytest.approx(HOME_ALT_M)
    assert flight.estimates is not None and (flight.estimates.flags == 831).all()
    assert flight.estimates.compass_ratio[0] == pytest.approx(0.2)
    assert flight.triggers_s is not None and len(flight.triggers_s) == len(PICTURES_S)


def test_a_gimbal_from_north(tmp_path: Path) -> None:
    log = write_ulog(tmp_path / "a.ulg", Flown(), gimbal_pitch_deg=-30.0)
    code, said = imported(log, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 0 and "yaw from north" in said
    flight = read_ulog(log, Given())
    assert flight.gimbal is not None and flight.gimbal.yaw_from == "earth"

    class North(Flown):
        def angles_deg(self, t_s: np.ndarray) -> np.ndarray:
            return np.stack([np.zeros(len(t_s)), np.full(len(t_s), -30.0), np.zeros(len(t_s))])

    errors = replayed(tmp_path / "out", flown=North())
    assert errors.frames >= 10 and errors.attitude_deg < 0.01


@pytest.mark.parametrize(
    ("left_out", "says"),
    [
        (("vehicle_attitude",), "tells no attitude: give --attitude FILE"),
        (("vehicle_global_position", "sensor_gps"), "tells no place"),
        (
            ("vehicle_attitude", "vehicle_global_position", "sensor_gps"),
            "without vehicle_attitude and vehicle_global_position: it holds",
        ),
    ],
)
def test_a_log_that_lacks_poses_is_refused_in_one_line(tmp_path: Path, left_out: tuple[str, ...], says: str) -> None:
    log = write_ulog(tmp_path / "a.ulg", Flown(), leave_out=left_out)
    code, said = imported(log, "--out", tmp_path / "out")
    assert (code, says in said, said.strip().count("\n")) == (1, True, 0), said


def test_the_receivers_place_stands_in(tmp_path: Path) -> None:
    flight = read_ulog(write_ulog(tmp_path / "a.ulg", Flown(), leave_out=("vehicle_global_position",)), Given())
    assert flight.positions is not None and len(flight.positions.time_s) == 100
    assert flight.remarks.assumed == ["places are the receiver's own: the log has no vehicle_global_position"]


def test_a_log_cut_off_in_the_middle_gives_what_it_has(log: Path, tmp_path: Path) -> None:
    data = log.read_bytes()
    for share in (0.4, 0.5003, 0.9):
        cut = tmp_path / f"{share}.ulg"
        cut.write_bytes(data[: int(share * len(data))])
        flight = read_ulog(cut, Given())
        assert flight.craft is not None and share - 0.1 < len(flight.craft.time_s) / 1000.0 < share + 0.1


def test_a_file_of_junk_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    foul = tmp_path / "x.ulg"
    foul.write_bytes(b"ULog\x01\x12\x35\x01" + np.random.default_rng(0).bytes(20_000))
    with pytest.raises(ImportRefusedError, match=r"x\.ulg: "):
        read_ulog(foul, Given())
    assert capfd.readouterr() == ("", "")


def test_without_pyulog_the_package_is_named(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyulog", None)
    with pytest.raises(ImportRefusedError, match=r"pip install '\.\[import\]'"):
        read_ulog(log, Given())


@pytest.mark.parametrize("seed", range(8))
def test_a_spoiled_log_is_read_or_refused(log: Path, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(log.read_bytes())
    for _ in range(20):
        data[int(rng.integers(0, len(data) if seed % 2 else 2000))] = int(rng.integers(0, 256))
    path = tmp_path / "a.ulg"
    path.write_bytes(data)
    code, said = imported(path, "--out", tmp_path / "out")
    assert code == 0 or (said.strip().count("\n") == 0 and not (tmp_path / "out").exists()), said
