"""A film with ST 0601 metadata of a simulated flight: its clock by the turning where nothing binds it, and the fire."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from distloc.simulation.paths import FlightPath, straight
from distloc.types import FloatArray
from service.config.load import load_config
from service.recordings.recording import Recording
from service.simulator.scenario import CameraConfig, ErrorSection, MountConfig, Scenario, load_scenario
from service.simulator.simulate import simulate
from tests.service.commands.importing.test_import import messages_of
from tests.support.flown import imported
from tests.support.misb_films import Carriage, klv, write_film

FPS, START_S, BOOT_S = 10.0, 1_780_000_000.0, 90.0
LATE_S = 0.2


class Rocking(Scenario, frozen=True):
    @property
    def flight(self) -> FlightPath:
        return straight(np.array([0.0, 0.0, 120.0]), 0.0, 12.0, wobble_rad=0.06, seed=7)


class Flight:
    """Pictures, when each was taken, and the poses at any time, in seconds since the autopilot's boot."""

    def __init__(self, folder: Path) -> None:
        camera = CameraConfig(
            width=640,
            height=360,
            fx=450.0,
            fy=450.0,
            cx=319.5,
            cy=179.5,
            mount=MountConfig(yaw_deg=-75.0, pitch_deg=-5.0),
        )
        errors = ErrorSection(heading_bias_deg=0.5, tilt_bias_deg=0.2, attitude_white_deg=0.02, position_sigma_m=1.0)
        targets = load_scenario("straight").targets
        simulate(
            folder, Rocking(targets=targets, camera=camera, errors=errors, fps=FPS, duration_s=30.0), 5, lambda _: None
        )
        recording, log = Recording(folder), folder / "telemetry.tlog"
        frames = recording.frames()
        self.pictures: list[NDArray[np.uint8]] = [np.asarray(recording.load_image(name)) for _, name in frames]
        self.taken_s = np.array([stamp_us * 1e-6 for stamp_us, _ in frames]) - START_S + BOOT_S
        self._angles = _rows(log, "ATTITUDE", "yaw", "pitch", "roll")
        self._angles[:, 1:] = np.degrees(np.unwrap(self._angles[:, 1:], axis=0))
        self._places = np.array(
            [(m.time_boot_ms, m.lat, m.lon, m.alt) for m in messages_of(log, "GLOBAL_POSITION_INT")]
        )  # type: ignore[attr-defined]

    def items(self, boot_s: float) -> dict[int, float | int]:
        yaw, pitch, roll = _at(self._angles, boot_s)
        lat, lon, alt = _at(self._places, boot_s) * [1e-7, 1e-7, 1e-3]
        return {
            2: round((START_S - BOOT_S + boot_s) * 1e6),
            **{5: yaw % 360.0, 90: pitch, 91: roll, 13: lat, 14: lon, 15: alt},
            **{16: 70.84, 17: 43.6, 18: 285.0, 19: -5.0, 20: 0.0},
        }


def _rows(log: Path, kind: str, *fields: str) -> FloatArray:
    return np.array([[getattr(m, name) for name in ("time_boot_ms", *fields)] for m in messages_of(log, kind)])


def _at(rows: FloatArray, boot_s: float) -> FloatArray:
    return np.array([np.interp(boot_s * 1e3, rows[:, 0], one) for one in rows[:, 1:].T])


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    return Flight(tmp_path_factory.mktemp("flights") / "flight")


@pytest.mark.parametrize(("carriage", "late_s"), [("sync", 0.0), ("async", LATE_S), ("async", -LATE_S)])
def test_each_frame_comes_to_the_time_at_which_it_was_taken(
    flight: Flight, tmp_path: Path, carriage: Carriage, late_s: float
) -> None:
    """What is not bound may come `late_s` after its picture: then the turning tells."""
    film = tmp_path / "film.ts"
    first_s = flight.taken_s[0] - late_s
    write_film(
        film,
        flight.pictures,
        lambda shown_s: klv(flight.items(first_s + shown_s)),
        carriage,
        FPS,
        codec="mp4v",
    )
    code, said = imported(film, "--out", tmp_path / "recording")
    assert code == 0, said
    stamps_s = np.array([stamp_us * 1e-6 for stamp_us, _ in Recording(tmp_path / "recording").frames()])
    off_s = stamps_s - (flight.taken_s + START_S - BOOT_S)
    if carriage == "sync":
        assert np.abs(off_s).max() < 0.002
        return
    tie = re.search(r"after the first pose, sigma (\d+) ms, by the turning in (\d+)", said)
    assert tie, said
    sigma_s = int(tie[1]) * 1e-3
    assert 0.001 <= sigma_s <= 0.02
    assert np.abs(off_s).max() < 0.01 + 3.0 * sigma_s


def test_where_the_turning_does_not_tell_the_errors_hold_what_it_may_cost(flight: Flight, tmp_path: Path) -> None:
    """The film stands still: of metadata that is not bound nothing says to which picture it belongs."""
    film = tmp_path / "film.ts"
    still = [flight.pictures[0]] * len(flight.pictures)
    first_s = flight.taken_s[0]
    write_film(film, still, lambda shown_s: klv(flight.items(first_s + shown_s)), "async", FPS, codec="mp4v")
    code, said = imported(film, "--out", tmp_path / "recording")
    assert code == 0, said
    told = re.search(r"on one clock within 0.3 s, .* less sure by the ([0-9.]+) deg", said)
    assert told, said
    at_s = np.arange(first_s, first_s + 29.0, 0.05)
    angles = np.array([[flight.items(one)[tag] for tag in (5, 90, 91)] for one in at_s])
    turned = np.abs(angles[6:] - angles[:-6])
    rms_deg = np.sqrt(np.mean(np.minimum(turned, 360.0 - turned) ** 2, axis=0)).max()  # about the craft's axes
    assert 0.5 * rms_deg < float(told[1]) < 1.5 * rms_deg
    config = load_config(tmp_path / "recording" / "config.toml")
    assert "the film turns and the angles do not follow it" in said  # nor does a film that stands still follow them
    assert np.hypot(0.5, float(told[1])) - 0.01 < config.pose_errors.tilt_bias_deg < 10.0
    assert np.hypot(2.0, float(told[1])) - 0.01 < config.pose_errors.heading_bias_deg < 12.0
