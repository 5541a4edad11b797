"""Films with ST 0601 metadata that others wrote, to flights: attitudes, places, times, what lacks, the whole way."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from stanag4609.st0601 import SpecialValue
from typer.testing import CliRunner

from distloc.geometry.rotations import R_FRD_FROM_CAM, matrix_from_euler, matrix_from_quaternion
from service.commands.cli import app
from service.recordings.importers.flight import Film, Given, ImportedFlight, ImportRefusedError
from service.recordings.importers.misb.reading import read_misb
from service.recordings.importers.readers import reader_of
from tests.support.misb_films import Carriage, klv, write_film

START_US = 1_780_000_000_250_000
START_S = 1_780_000_000.25
FPS, COUNT = 25.0, 100


def texture(shift_px: float) -> NDArray[np.uint8]:
    rng = np.random.default_rng(1)
    base = cv2.GaussianBlur(rng.integers(0, 255, (240, 640, 3)).astype(np.uint8), (0, 0), 2.0)
    return np.asarray(np.roll(base, round(shift_px), axis=1)[:, :320], dtype=np.uint8)


PICTURES = [texture(2.0 * i) for i in range(COUNT)]


def items_at(shown_s: float) -> dict[int, Any]:
    """A craft that turns, rolls steeply and climbs, with a camera that looks right and down."""
    return {
        2: START_US + round(shown_s * 1e6),
        5: (350.0 + 8.0 * shown_s) % 360.0,
        **{6: 3.0, 7: SpecialValue.OUT_OF_RANGE, 90: 3.0, 91: -60.0},
        **{13: 47.4 + 1e-4 * shown_s, 14: 8.5, 15: 650.0 + shown_s, 75: 698.0 + shown_s},
        **{16: 60.0, 17: 46.8, 18: 30.0, 19: -12.0, 20: 1.0},
    }


def imported(
    tmp_path: Path, change: Mapping[int, Any] | None = None, carriage: Carriage = "sync", without: tuple[int, ...] = ()
) -> ImportedFlight:
    def packet_of(shown_s: float) -> bytes:
        items = {**items_at(shown_s), **(change or {})}
        return klv({tag: value for tag, value in items.items() if tag not in without})

    path = tmp_path / "film.ts"
    write_film(path, PICTURES, packet_of, carriage, FPS)
    return read_misb(path, Given())


@pytest.mark.parametrize("carriage", ["sync", "async"])
def test_the_camera_looks_where_platform_and_sensor_say(tmp_path: Path, carriage: Carriage) -> None:
    flight = imported(tmp_path, carriage=carriage)
    assert flight.camera is not None and flight.craft is not None and flight.epoch_s == 1_780_000_000.0
    sensor = matrix_from_euler(*np.radians([30.0, -12.0, 1.0]))
    for time_s, craft_q, camera_q in zip(
        flight.camera.time_s, flight.craft.q_ned_from_body, flight.camera.q_ned_from_body, strict=True
    ):
        platform = matrix_from_euler(*np.radians([350.0 + 8.0 * (time_s - 0.25), 3.0, -60.0]))
        assert np.allclose(matrix_from_quaternion(craft_q), platform, atol=2e-4)  # the heading's 16 bits
        looks, told = (R @ R_FRD_FROM_CAM for R in (matrix_from_quaternion(camera_q), platform @ sensor))
        assert np.allclose(looks, told, atol=2e-4)


@pytest.mark.parametrize("carriage", ["sync", "async"])
def test_each_frame_is_at_its_packets_stamp(tmp_path: Path, carriage: Carriage) -> None:
    flight = imported(tmp_path, carriage=carriage)
    assert isinstance(flight.frames, Film) and flight.epoch_s is not None
    told_s = START_S + np.arange(COUNT) / FPS
    within_s = 2e-5 if carriage == "sync" else flight.tied_within_s
    assert flight.frames.time_s + flight.epoch_s == pytest.approx(told_s, abs=within_s)
    assert flight.frames_tied == (carriage == "sync")
    assert (flight.tied_within_s is None) == (carriage == "sync")


def test_places_and_both_heights_are_as_told(tmp_path: Path) -> None:
    positions = imported(tmp_path).positions
    assert positions is not None and len(positions.time_s) == COUNT
    at_s = positions.time_s - 0.25
    assert positions.lat_deg == pytest.approx(47.4 + 1e-4 * at_s, abs=5e-8)
    assert positions.alt_msl_m == pytest.approx(650.0 + at_s, abs=0.16)
    assert positions.alt_ellipsoid_m == pytest.approx(698.0 + at_s, abs=0.16)


def test_what_is_not_told_is_said_to_lack(tmp_path: Path) -> None:
    flight = imported(tmp_path, {15: 650.0}, without=(16, 18, 19, 20))
    assert flight.camera is None and flight.craft is not None
    assert flight.lens is not None and flight.lens.hfov_deg is None
    lacks = " ".join(flight.remarks.lacks)
    assert "sensor's angles" in lacks and "field of view" in lacks
    none = imported(tmp_path, {91: SpecialValue.OUT_OF_RANGE})
    assert none.craft is None and none.camera is None
    assert "the platform's attitude (5 to 7)" in none.remarks.lacks


def test_a_picture_with_another_field_of_view_gets_no_attitude(tmp_path: Path) -> None:
    path = tmp_path / "zoom.ts"
    write_film(path, PICTURES, lambda s: klv({**items_at(s), 16: 60.0 if s < 2.5 else 20.0}), "sync", FPS)
    flight = read_misb(path, Given())
    assert flight.lens is not None and flight.lens.hfov_deg == pytest.approx(60.0, abs=0.01)
    assert flight.camera is not None and flight.camera.time_s.max() < 0.25 + 2.5
    assert any("zooms" in line for line in flight.remarks.lacks)


def test_stamps_that_run_back_and_packets_that_are_broken_are_counted(tmp_path: Path) -> None:
    def packet_of(shown_s: float) -> bytes:
        number = round(shown_s * FPS)
        if number == 40:
            return klv({**items_at(shown_s), 2: START_US - 3_600_000_000})
        if number == 50:
            return klv({**items_at(shown_s), 2: 2**63})
        packet = klv(items_at(shown_s))
        return packet[:-1] + bytes((packet[-1] ^ 1,)) if number == 60 else packet

    path = tmp_path / "odd.ts"
    write_film(path, PICTURES, packet_of, "sync", FPS)
    flight = read_misb(path, Given())
    dropped = flight.remarks.dropped
    assert dropped["metadata: a wrong checksum"] == 1
    assert dropped["metadata: a time before 1970 or after 2100"] == 1
    assert dropped["position: time runs backwards"] == 1
    assert flight.positions is not None and len(flight.positions.time_s) == COUNT - 3
    assert isinstance(flight.frames, Film) and flight.epoch_s is not None
    assert flight.frames.time_s[0] + flight.epoch_s == pytest.approx(START_S, abs=2e-5)


def test_a_film_without_one_good_packet_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.ts"
    write_film(path, PICTURES[:10], lambda s: klv(items_at(s)), "sync", FPS)
    data = path.read_bytes().replace(b"\x06\x0e\x2b\x34", b"\x06\x0e\x2b\x35")
    path.write_bytes(data)
    with pytest.raises(ImportRefusedError, match=r"no packet of ST 0601 can be used \(10 metadata: no whole packet"):
        read_misb(path, Given())


def test_a_recording_of_it_replays(tmp_path: Path) -> None:
    path, out, played = tmp_path / "film.ts", tmp_path / "recording", tmp_path / "played"
    write_film(path, PICTURES, lambda s: klv({**items_at(s), 7: -2.0, 91: -2.0}), "sync", FPS)
    assert reader_of(path).name == "a film in MPEG-TS with MISB ST 0601"
    said = CliRunner().invoke(app, ["import", str(path), "--out", str(out)])
    assert said.exit_code == 0, said.output
    assert "clocks tied by 100 packets bound to the pictures" in said.output
    replayed = CliRunner().invoke(app, ["replay", str(out), "--out", str(played)])
    assert replayed.exit_code == 0, replayed.output
    used = re.search(r"(\d+) of 100 frames used", replayed.output)
    assert used and int(used[1]) > 70, replayed.output


@pytest.mark.parametrize("share", [0.3, 0.55])
def test_a_film_that_begins_between_two_whole_pictures_keeps_its_times(tmp_path: Path, share: float) -> None:
    """What is shown tells which picture it is: each is brighter by 2 than the one before."""
    path = tmp_path / "film.ts"
    bright = [np.full((240, 320, 3), 20 + 2 * i, np.uint8) for i in range(COUNT)]
    write_film(path, bright, lambda s: klv(items_at(s)), "sync", FPS)
    data = path.read_bytes()
    start = int(len(data) * share) // 188 * 188
    path.write_bytes(data[: 2 * 188] + data[start:])
    flight = read_misb(path, Given())
    assert isinstance(flight.frames, Film) and flight.epoch_s is not None
    capture = cv2.VideoCapture(str(path))
    shown = []
    while (image := capture.read()[1]) is not None:
        shown.append((float(image.mean()) - 20.0) / 2.0)
    capture.release()
    assert len(shown) == len(flight.frames.time_s) > 20
    number = np.round(np.array(shown) - shown[-1]) + COUNT - 1  # the last is whole
    off_s = np.abs(flight.frames.time_s + flight.epoch_s - (START_S + number / FPS))
    assert np.mean(off_s < 0.002) > 0.9  # of a few the brightness is off by one
    assert flight.frames_tied
