"""What is tried where distloc is installed, a board or a root folder of one: `board.py RECORDING OUT [REFERENCE]`.

The command line answers, the doctor looks, the recording is replayed and a rendered frame goes through the shipped
model. With a REFERENCE, the OUT of another machine, what came out must be the same: tests/boards/run does both.
"""

import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from distloc.geometry.camera import Camera
from distloc.geometry.rotations import R_cam_from_enu, matrix_from_euler
from distloc.simulation.renderer import Plume, Renderer
from distloc.types import CameraPose
from service.config.sections import SegmenterConfig
from service.segmenters import model_session
from service.segmenters.onnx import OnnxSegmenter
from service.segmenters.segment import shipped_model

MOST_APART_M, MOST_APART = 1.0, 0.01  # what two machines' reports may differ by: places, and all sizes by a share
MOST_PROBABILITY = 0.01
_M_PER_DEG = 111_320.0
_CAMERA = Camera(1280, 720, 900.0, 900.0, 640.0, 360.0)


def distloc(*arguments: str) -> str:
    """What the command line printed; ends the run where it failed."""
    command = [str(Path(sys.executable).parent / "distloc"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"distloc {' '.join(arguments)}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def rendered_frame() -> NDArray[np.uint8]:
    """A plume before a landscape, 1280 x 720."""
    R = R_cam_from_enu(matrix_from_euler(0.1, np.radians(-5.0), 0.03), np.eye(3))
    plume = Plume(np.array([0.0, 1500.0, 0.0]), 160.0, 120.0, np.array([2.0, 0.0, 0.0]))
    image, _ = Renderer(_CAMERA, [plume], np.random.default_rng(0)).render(
        CameraPose(60.0, np.array([0.0, 0.0, 120.0]), R)
    )
    return image


def look(frame: Path, out: Path) -> str:
    """The shipped model's probability of smoke in the frame, kept in `out`."""
    model_session.RUN_LIMIT_S = 3600.0  # an emulated board's time says nothing of a real one's
    settings = SegmenterConfig(kind="onnx", model=str(shipped_model()), providers=("CPUExecutionProvider",))
    segmenter = OnnxSegmenter(
        model_session.ModelSession(Path(settings.model), settings.providers, ""), _CAMERA, settings
    )
    image = cv2.imread(str(frame))
    assert image is not None
    probability = segmenter.probability(image)  # type: ignore[arg-type]
    np.save(out, probability)
    return f"up to {probability.max():.3f}, {np.count_nonzero(probability > segmenter.threshold)} pixels are smoke"


def features(folder: Path) -> list[dict[str, Any]]:
    """The replay's reports."""
    return [json.loads(line) for line in (folder / "reports.jsonl").read_text(encoding="utf-8").splitlines()]


def sizes(report: dict[str, Any]) -> NDArray[np.float64]:
    """Lengths of a report that must agree to a share: both ellipses, the range."""
    said = report["properties"]
    both = [said[name][axis] for name in ("ellipse95", "region95") for axis in ("semi_major_m", "semi_minor_m")]
    return np.array([*both, said["range_m"]])


def apart_m(one: dict[str, Any], other: dict[str, Any]) -> float:
    """Metres between the places of two reports."""
    east_deg, north_deg, up_m = np.subtract(one["geometry"]["coordinates"], other["geometry"]["coordinates"])
    scale = np.cos(np.radians(one["geometry"]["coordinates"][1]))
    return float(np.linalg.norm([east_deg * scale * _M_PER_DEG, north_deg * _M_PER_DEG, up_m]))


def compared(ours: Path, reference: Path) -> str:
    """How far this machine's results are from the reference's; ends the run where that is too far."""
    pairs = list(zip(features(ours / "replay"), features(reference / "replay"), strict=True))
    keys = ("target", "seq", "state", "motion", "observations")
    unlike = [key for key in keys if any(a["properties"][key] != b["properties"][key] for a, b in pairs)]
    metres = max(apart_m(a, b) for a, b in pairs)
    share = max(float(np.abs(sizes(a) / sizes(b) - 1.0).max()) for a, b in pairs)
    probability = float(np.abs(np.load(ours / "smoke.npy") - np.load(reference / "smoke.npy")).max())
    said = f"{len(pairs)} reports: {metres:.3g} m and {share:.2%} apart; the model's probabilities: {probability:.1g}"
    if unlike or metres > MOST_APART_M or share > MOST_APART or probability > MOST_PROBABILITY:
        raise SystemExit(f"not the same as the reference: {said}; unlike: {', '.join(unlike) or 'no key'}")
    return said


def main(arguments: Sequence[str]) -> None:
    """Try all of it, a line each."""
    recording, out = Path(arguments[0]), Path(arguments[1])
    reference = Path(arguments[2]) if len(arguments) > 2 else None
    out.mkdir(parents=True)
    frame = out / "frame.png"
    if reference is None:
        cv2.imwrite(str(frame), rendered_frame())
    else:
        frame.write_bytes((reference / "frame.png").read_bytes())  # the same picture for both
    steps: list[tuple[str, Callable[[], str]]] = [
        ("machine", lambda: f"{platform.machine()}, Python {platform.python_version()}"),
        ("help", lambda: distloc("--help").strip().splitlines()[0]),
        ("check", lambda: distloc("check", "--seconds", "1").strip().splitlines()[-1]),
        ("replay", lambda: distloc("replay", str(recording), "--out", str(out / "replay")).strip().splitlines()[-2]),
        ("model", lambda: look(frame, out / "smoke.npy")),
    ]
    if reference is not None:
        steps.append(("same", lambda: compared(out, reference)))
    for name, step in steps:
        start_s = time.monotonic()
        said = step()
        print(f"{name}: {said} ({time.monotonic() - start_s:.0f} s)", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
