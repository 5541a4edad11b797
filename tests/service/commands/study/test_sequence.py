"""The paper's Table 2 for a recording: on a real flight, on a simulated one, and what is said where something lacks."""

import csv
import dataclasses
import io
import json
import shutil
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from distloc.study.methods import bootstrap_spec, calibrated_spec, paper_methods
from distloc.types import CameraPose, FloatArray, MaskArray, RejectReason
from service.commands.study.sequence.observed import ObservedSequence, observe_sequence
from service.commands.study.sequence.run import SequenceResult, run_sequence, write_sequence
from service.config.load import load_config
from service.config.sections import ConfigError, MountConfig
from service.recordings.recording import Recording, RecordingError
from service.simulator.scenario import CameraConfig, camera_pose, centre_enu_m, load_scenario
from service.simulator.simulate import simulate
from tests.support.places import CUT

# 0.5 deg rms of slow yaw error over 680 m at 2 km: 18 m across and R^2 / B * 0.5 deg = 54 m along the sight
RANGE_M, LEAST_SHARE, RMVT_SHARE, PF_SHARE = 2038.0, 0.005, 0.05, 0.08


def observe(folder: Path, step_m: float = 10.0) -> ObservedSequence:
    return observe_sequence(Recording(folder), load_config(folder / "config.toml"), lambda stamp_ns: None, step_m)


def table(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))


@pytest.fixture(scope="module")
def observed() -> ObservedSequence:
    return observe(CUT)


@pytest.fixture(scope="module")
def result(observed: ObservedSequence) -> SequenceResult:
    """A fifth of the paper's particles: the rows differ by metres, the time by five."""
    methods = (*paper_methods()[:3], bootstrap_spec("PF", n_particles=20_000), calibrated_spec())
    return run_sequence(observed, methods, runs=2, seed=1)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return Path(shutil.copytree(CUT, tmp_path / "copy"))


@dataclass(frozen=True)
class Scripted:
    """A spec whose method gives `position(frame's number, random number of the run)` and keeps what it was given."""

    name: str
    position: Callable[[int, float], FloatArray | RejectReason | None]
    given: list[tuple[float, int]]

    def make(self, camera: object, rng: np.random.Generator) -> Any:
        spec, number, draw = self, iter(range(10_000)), float(rng.random())

        class Method:
            particles_enu_m = None

            def step(self, pose: CameraPose, mask: MaskArray) -> FloatArray | RejectReason | None:
                spec.given.append((pose.stamp_s, zlib.crc32(mask.tobytes())))
                return spec.position(next(number), draw)

        return Method()


def test_rows_of_a_real_flight(result: SequenceResult) -> None:
    rows = {row.method: row for row in result.summary()}
    assert list(rows) == ["MVT", "RMVT-literal", "RMVT", "PF", "RBPF"]
    for method, most_share in (("RMVT", RMVT_SHARE), ("PF", PF_SHARE), ("RBPF", RMVT_SHARE)):
        row = rows[method]
        assert row.min_m is not None and row.mean_m is not None and row.horizontal_mean_m is not None
        assert LEAST_SHARE * RANGE_M < row.mean_m < most_share * RANGE_M
        assert 0.0 < row.min_m <= row.mean_m
        assert row.horizontal_mean_m <= row.mean_m
        assert (row.runs, row.estimated_share) == (2, 1.0)
        assert row.baseline_m == pytest.approx(680.0, abs=15.0)
        assert row.mean_range_m == pytest.approx(RANGE_M, rel=0.02)


def test_every_method_gets_the_recorded_masks_a_step_apart(observed: ObservedSequence) -> None:
    both = [Scripted(name, lambda number, draw: None, []) for name in ("one", "two")]
    run_sequence(observed, both, runs=1, seed=0)  # type: ignore[arg-type]
    assert both[0].given == both[1].given
    name_of = {int(row["stamp_us"]): row["file"] for row in table(CUT / "frames.csv")}
    for stamp_s, crc in both[0].given:
        recorded = cv2.imread(str(CUT / "masks" / f"{name_of[round(stamp_s * 1e6)]}.png"), cv2.IMREAD_UNCHANGED)
        assert recorded is not None and zlib.crc32(recorded.tobytes()) == crc
    positions_enu_m = np.stack([pose.position_enu_m for pose in observed.poses])
    steps_m = np.linalg.norm(np.diff(positions_enu_m, axis=0), axis=1)
    assert steps_m.min() >= 10.0 and np.median(steps_m) < 14.0  # 10 m/s at 4 frames a second
    assert len(name_of) == len(steps_m) + 1 + observed.before + observed.between + sum(observed.refused.values())


def test_errors_are_to_the_nearest_truth_and_gaps_are_none(observed: ObservedSequence) -> None:
    (near,) = observed.truths_enu_m
    two = np.stack([near + np.array([9000.0, 0.0, 0.0]), near])
    observed = dataclasses.replace(observed, truths_enu_m=two)
    count, offset = len(observed.poses), np.array([3.0, 4.0, 12.0])
    specs = [
        Scripted("off", lambda number, draw: near + offset, []),
        Scripted("early", lambda number, draw: near + offset if number < count // 4 else RejectReason.NO_BASELINE, []),
        Scripted("odd", lambda number, draw: near + offset * draw if number % 2 else np.full(3, np.nan), []),
    ]
    off, early, odd = run_sequence(observed, specs, runs=3, seed=0).summary()  # type: ignore[arg-type]
    assert (off.min_m, off.mean_m, off.horizontal_mean_m, off.estimated_share) == (13.0, 13.0, 5.0, 1.0)
    assert (early.min_m, early.mean_m, early.horizontal_mean_m, early.estimated_share) == (13.0, None, None, 0.0)
    draws = [np.random.Generator(np.random.SFC64(np.random.SeedSequence([0, run]))).random() for run in range(3)]
    assert odd.mean_m == pytest.approx(13.0 * float(np.mean(draws)), abs=0.01)
    assert 0.4 < odd.estimated_share < 0.6


def test_seed_decides_the_rows_for_any_jobs(observed: ObservedSequence) -> None:
    specs = (paper_methods()[2], bootstrap_spec("PF", n_particles=2000))
    done: list[int] = []
    one = run_sequence(observed, specs, 2, 7).summary()
    assert run_sequence(observed, specs, 2, 7, jobs=2, on_done=done.append).summary() == one
    assert done == [1, 2, 3, 4]
    assert run_sequence(observed, specs, 2, 8).summary()[1] != one[1]


def test_written_files_agree(result: SequenceResult, tmp_path: Path) -> None:
    write_sequence(result, tmp_path / "out", "cut")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "curves.csv",
        "error.png",
        "sequence.csv",
        "sequence.json",
    ]
    rows = json.loads((tmp_path / "out" / "sequence.json").read_bytes())
    assert [{key: str(value) for key, value in row.items()} for row in rows] == table(tmp_path / "out" / "sequence.csv")
    curve = [row for row in table(tmp_path / "out" / "curves.csv") if row["method"] == "RMVT"]
    assert curve[0]["error_m"] == "" and float(curve[0]["translation_m"]) == 0.0  # one view gives no point
    late = [float(row["error_m"]) for row in curve if float(row["translation_m"]) >= 0.75 * rows[2]["baseline_m"]]
    assert np.mean(late) == pytest.approx(rows[2]["mean_m"], abs=0.02)


def test_simulated_flight(tmp_path: Path) -> None:
    mount = MountConfig(yaw_deg=-75.0, pitch_deg=-5.0)
    camera = CameraConfig(width=320, height=180, fx=225.0, fy=225.0, cx=159.5, cy=89.5, mount=mount)
    scenario = msgspec.structs.replace(load_scenario("straight"), camera=camera, fps=2.0, duration_s=16.0)
    simulate(tmp_path / "flight", scenario, 3, lambda share: None)
    config = load_config(tmp_path / "flight" / "config.toml")
    config = msgspec.structs.replace(config, segmenter=msgspec.structs.replace(config.segmenter, kind="recorded"))
    observed = observe_sequence(Recording(tmp_path / "flight"), config, lambda stamp_ns: None)
    assert 25 <= len(observed.poses) <= 32  # 14 m from frame to frame: every one, but while the link starts
    (truth,) = [centre_enu_m(target) for target in scenario.targets]
    last_m = float(np.linalg.norm(truth - camera_pose(scenario, 15.5, 0.0).position_enu_m))
    assert observed.range_m[-1] == pytest.approx(last_m, abs=5.0)
    assert observed.translation_m[-1] == pytest.approx(28.0 * 0.5 * (len(observed.poses) - 1), rel=0.1)
    rows = run_sequence(observed, paper_methods()[:2], runs=1, seed=0).summary()
    for row in rows:  # 0.05 deg of white error and a pixel of 0.25 deg over a baseline of 400 m
        assert row.mean_m is not None and 0.5 < row.mean_m < 0.1 * last_m


def one_line(error: pytest.ExceptionInfo[Exception], folder: Path) -> str:
    text = str(error.value)
    assert "\n" not in text and str(folder) in text
    return text


def test_missing_truth(copy: Path) -> None:
    (copy / "truth.json").write_text('{"targets": []}')
    with pytest.raises(RecordingError, match=r"truth\.json with at least one target is missing") as error:
        observe(copy)
    one_line(error, copy)
    (copy / "truth.json").unlink()
    with pytest.raises(RecordingError, match=r"truth\.json with at least one target is missing"):
        observe(copy)


def test_no_masks(copy: Path) -> None:
    masks = sorted((copy / "masks").iterdir())
    empty = cv2.imencode(".png", np.zeros((108, 192), np.uint8))[1].tobytes()
    for mask in masks:
        mask.write_bytes(empty)
    masks[-1].unlink()
    with pytest.raises(RecordingError, match="no frame with a pose has a positive pixel") as error:
        observe(copy)
    assert "masks empty, 1 frame_missing" in one_line(error, copy)
    shutil.rmtree(copy / "masks")
    with pytest.raises(ConfigError, match="no such folder") as missing:
        observe(copy)
    one_line(missing, copy)


def test_no_pose_no_frames_no_translation(copy: Path) -> None:
    with pytest.raises(RecordingError, match="moved less than 5000 m") as error:
        observe(copy, 5000.0)
    one_line(error, copy)
    tlog = copy / "telemetry.tlog"
    tlog.write_bytes(tlog.read_bytes()[:2000])
    with pytest.raises(RecordingError, match=r"none of \d+ frames has a pose \(\d+ no_") as error:
        observe(copy)
    one_line(error, copy)
    (copy / "frames.csv").unlink()
    with pytest.raises(RecordingError, match=r"frames\.csv with at least one frame is missing"):
        observe(copy)
