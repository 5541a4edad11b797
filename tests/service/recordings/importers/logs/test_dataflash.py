"""ArduPilot's logs to recordings: what the code that flies makes of them, and what is said of poor ones."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from service.recordings.importers.flight import Given, ImportRefusedError
from service.recordings.importers.logs.dataflash import read_dataflash
from tests.support.dataflash import BOOT_S, MESSAGES, row, write_dataflash
from tests.support.flown import EPOCH_S, HOME_ALT_M, PICTURES_S, UNDULATION_M, Flown, imported, replayed, write_pictures
from tests.support.places import HANG_S

CAMERA = ("--hfov", 60)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_dataflash(tmp_path_factory.mktemp("log") / "00000042.BIN", Flown())


def test_another_reader_finds_what_the_writer_wrote(log: Path) -> None:
    command = [sys.executable, "-m", "pymavlink.tools.mavlogdump", "--types", "ATT,POS", str(log)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert done.stdout.count("ATT {") == 500 and done.stdout.count("POS {") == 200
    first = next(line for line in done.stdout.splitlines() if "POS {" in line)
    lat = float(re.search(r"Lat : ([0-9.]+)", first)[1])  # type: ignore[index]
    assert lat == pytest.approx(47.4275, abs=1e-7)
    assert first.startswith("2026-07-14")


def test_poses_of_the_recording_are_the_logs(log: Path, tmp_path: Path) -> None:
    pictures = write_pictures(tmp_path / "pictures")
    code, said = imported(log, pictures, "--out", tmp_path / "out", *CAMERA)
    assert code == 0, said
    errors = replayed(tmp_path / "out")
    assert errors.frames == len(PICTURES_S)
    # angles in hundredths of a degree, 25 a second; places of 1 cm, velocities of 1 cm/s, stamps of 1 ms at 10 m/s
    assert 0.0 < errors.attitude_deg < 0.03
    assert 0.0 < errors.position_m < 0.03


def test_what_the_log_tells_is_there(log: Path) -> None:
    flight = read_dataflash(log, Given())
    assert flight.epoch_s == pytest.approx(EPOCH_S - BOOT_S, abs=0.002)
    assert flight.fixes is not None and (flight.fixes.fix_type == 4).all() and (flight.fixes.satellites == 17).all()
    assert flight.fixes.h_acc_m[5] == pytest.approx(0.9) and flight.fixes.v_acc_m[5] == pytest.approx(1.4)
    assert flight.positions is not None
    undulation_m = flight.positions.alt_ellipsoid_m - flight.positions.alt_msl_m
    assert undulation_m[0] == pytest.approx(UNDULATION_M, abs=0.01)
    assert flight.positions.velocity_ned_mps[50, 0] > 5.0  # of the core that is flown by
    assert flight.home is not None and flight.home[2] == pytest.approx(HOME_ALT_M)
    assert flight.estimates is not None and (flight.estimates.flags == 831).all()
    assert flight.estimates.compass_ratio[3] == pytest.approx(0.2)


def test_releases_of_the_camera_time_the_pictures(log: Path, tmp_path: Path) -> None:
    pictures = write_pictures(tmp_path / "pictures")
    (pictures / "frames.csv").unlink()
    for number, path in enumerate(sorted((pictures / "frames").iterdir(), key=lambda one: int(one.stem))):
        path.rename(pictures / "frames" / f"DSC{number:05d}.png")
    code, said = imported(log, pictures / "frames", "--out", tmp_path / "out", *CAMERA)
    assert code == 0, said
    assert f"{len(PICTURES_S)} pictures by as many releases of the camera" in said
    assert replayed(tmp_path / "out").attitude_deg < 0.03
    next((pictures / "frames").iterdir()).unlink()
    code, said = imported(log, pictures / "frames", "--out", tmp_path / "other", *CAMERA)
    assert code == 1 and "12 releases of the camera for 11 of them" in said


def test_a_gimbal_turns_the_camera(tmp_path: Path) -> None:
    log = write_dataflash(tmp_path / "a.bin", Flown(), mount_deg=(-20.0, 40.0))
    flight = read_dataflash(log, Given())
    assert flight.gimbal is not None and flight.gimbal.yaw_from == "vehicle"
    code, said = imported(log, write_pictures(tmp_path / "p"), "--out", tmp_path / "out", *CAMERA)
    assert code == 0 and "yaw from the nose" in said
    assert "gimbal = true" in (tmp_path / "out" / "config.toml").read_text()
    from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
    from service.config.load import load_config
    from service.recordings.posed_frames import PosedFrames
    from service.recordings.recording import Recording
    from tests.support.flown import angle_deg

    posed = PosedFrames(Recording(tmp_path / "out"), load_config(tmp_path / "out" / "config.toml"))
    off_deg = []
    for frame, pose in posed.pairs(lambda stamp_ns: None):
        yaw_deg = Flown().angles_deg(np.array([frame.stamp_ns * 1e-9 - EPOCH_S]))[0, 0]
        R_ned_from_gimbal = matrix_from_euler(*np.radians([yaw_deg + 40.0, -20.0, 0.0]))
        off_deg.append(angle_deg(R_cam_from_enu(R_ned_from_gimbal, np.eye(3)) @ pose.R_cam_from_enu.T))
    assert len(off_deg) >= 10 and max(off_deg) < 0.03


@pytest.mark.parametrize(
    ("left_out", "says"),
    [
        (("ATT",), "tells no attitude: give --attitude FILE"),
        (("POS", "GPS"), "tells no place"),
        (("ATT", "POS", "GPS"), "without attitudes (ATT) and places (POS): it holds"),
    ],
)
def test_a_log_that_lacks_poses_is_refused_in_one_line(tmp_path: Path, left_out: tuple[str, ...], says: str) -> None:
    log = write_dataflash(tmp_path / "a.bin", Flown(), leave_out=left_out)
    code, said = imported(log, "--out", tmp_path / "out")
    assert (code, says in said, said.strip().count("\n")) == (1, True, 0), said
    assert list(tmp_path.iterdir()) == [log]


def test_a_log_cut_off_in_the_middle_gives_what_it_has(log: Path, tmp_path: Path) -> None:
    data = log.read_bytes()
    for share in (0.4, 0.5003, 0.9):
        cut = tmp_path / f"{share}.bin"
        cut.write_bytes(data[: int(share * len(data))])
        flight = read_dataflash(cut, Given())
        assert flight.craft is not None and share - 0.1 < len(flight.craft.time_s) / 500.0 < share + 0.1


def test_junk_between_messages_costs_no_more_than_itself(
    log: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    data = log.read_bytes()
    foul = tmp_path / "foul.bin"
    at = data.index(b"\xa3\x95\x0a", len(data) // 2)
    foul.write_bytes(data[:at] + np.random.default_rng(1).bytes(4000).replace(b"\xa3", b"x") + data[at:])
    flight = read_dataflash(foul, Given())
    assert flight.craft is not None and len(flight.craft.time_s) == 500
    assert capfd.readouterr() == ("", "")  # the parser has much to say of it


def test_rows_of_wild_times_and_numbers_are_counted(log: Path, tmp_path: Path) -> None:
    foul = tmp_path / "foul.bin"
    extra = [row("ATT", int(4e15), 0, 1, 0, 1, 0, 1, 0, 0, 3), row("POS", 20_000_000, 0.0, 0.0, 5.0, 5.0, 5.0)]
    extra.append(row("POS", 20_000_001, 47.0, 8.0, float("nan"), float("nan"), 0.0))
    data = log.read_bytes()
    at = data.index(b"\xa3\x95\x0a", len(data) // 2)
    foul.write_bytes(data[:at] + b"".join(extra) + data[at:])
    flight = read_dataflash(foul, Given())
    assert flight.craft is not None and len(flight.craft.time_s) == 500
    assert flight.remarks.dropped == {
        "attitude: a time days from the others'": 1,
        "position: 0, 0, as before a fix": 1,
        "position: no height": 1,
    }


def test_what_is_none_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "x.bin"
    other.write_bytes(b"\xa3\x95\x80" + bytes(range(256)) * 40)
    with pytest.raises(ImportRefusedError, match=r"x\.bin: "):
        read_dataflash(other, Given())


def test_words_of_long_before_or_after_the_flight_are_left_out(tmp_path: Path) -> None:
    log = write_dataflash(tmp_path / "a.bin", Flown())
    far = [row("MNT", int(at_s * 1e6), 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for at_s in (0.0, 1e3, 9e9)]
    far += [row("XKF4", int(9e15), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 831, 0, 0)]
    log.write_bytes(log.read_bytes() + b"".join(far))
    code, said = imported(log, "--out", tmp_path / "out")
    assert code == 0, said
    assert 20e6 < stamps_of(tmp_path / "out" / "telemetry.tlog") < 40e6


def stamps_of(tlog: Path) -> int:
    """From the first to the last, us."""
    from service.recordings.tlog import TlogReader

    stamps = [stamp_us for stamp_us, _ in TlogReader(tlog)]
    return max(stamps) - min(stamps)


@pytest.mark.parametrize("seed", range(8))
def test_a_spoiled_log_is_read_or_refused(log: Path, tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(log.read_bytes())
    for _ in range(20):
        data[int(rng.integers(0, len(data) if seed % 2 else 2000))] = int(rng.integers(0, 256))
    path = tmp_path / "a.bin"
    path.write_bytes(data)
    code, said = imported(path, "--out", tmp_path / "out")
    assert code == 0 or (said.strip().count("\n") == 0 and not (tmp_path / "out").exists()), said


def test_a_text_log_is_read_as_well(tmp_path: Path) -> None:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += [f"FMT, {kind}, 40, {name}, {form}, {columns}" for name, (kind, form, columns) in MESSAGES.items()]
    for t_s in Flown().times_s(10.0):
        stamp = round((BOOT_S + t_s) * 1e6)
        (yaw, pitch, roll), (lat, lon, alt) = (
            one(np.array([t_s]))[:, 0] for one in (Flown().angles_deg, Flown().place)
        )
        lines.append(f"ATT, {stamp}, 0.0, {roll:.2f}, 0.0, {pitch:.2f}, 0.0, {yaw:.2f}, 0.0, 0.0, 3")
        lines.append(f"POS, {stamp}, {lat:.7f}, {lon:.7f}, {alt:.2f}, {alt - HOME_ALT_M:.2f}, 0.0")
    path = tmp_path / "2026-07-14.log"
    path.write_text("\n".join(lines) + "\n")
    flight = read_dataflash(path, Given())
    assert flight.craft is not None and len(flight.craft.time_s) == 200
    assert flight.positions is not None and flight.positions.lat_deg[0] == pytest.approx(47.4275, abs=1e-7)
    code, said = imported(path, "--out", tmp_path / "out")
    assert code == 0 and "a date: the recording's clock begins in 1970" in said
