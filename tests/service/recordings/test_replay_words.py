"""What a replay says in its last line, and when it fails: nothing could be used."""

import shutil
import sys
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.commands.cli import main
from service.config.load import load_config
from service.config.sections import Config
from service.recordings.flights import new_flight
from service.recordings.posed_frames import PosedFrames
from service.recordings.recording import Recording
from service.recordings.replay_words import Outcome
from tests.support.places import CUT


def outcome(**values: object) -> Outcome:
    most = {"localised": 0, "rejects": Counter(), "bad_rows": Counter(), "seconds": Counter(pose=9)}
    return Outcome(**{**most, "has_table": True, "is_bare": False, **values})  # type: ignore[arg-type]


def test_one_line_says_what_was_used_and_why_the_rest_was_not() -> None:
    said = outcome(
        localised=100,
        rejects=Counter(no_pose=2, bad_frame=12),
        bad_rows=Counter(bad_name=3),
        seconds=Counter(pose=50, no_clock=10),
        wild=1,
        steps=1,
        faint_masks=7,
    )
    assert said.is_useful
    assert str(said) == (
        "100 of 114 frames used, not used: 12 bad_frame, 2 no_pose; "
        "poses in 50 of 60 s, else 10 no_clock (no TIMESYNC and no time since boot); "
        "bad rows in frames.csv: 3 bad_name; "
        "7 masks have no pixel above 127 though some above 0: smoke is 255 (or 1); "
        "1 records of the log with wild stamps left out; the log's clock was set 1 times: put right"
    )


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"rejects": Counter(no_fix=3), "seconds": Counter(no_fix=9)},
            "0 of 3 frames used, not used: 3 no_fix; no pose",
        ),
        ({"has_table": False}, "no frames: no frames.csv; poses in 9 of 9 s"),
        ({}, "no frames: frames.csv has none"),
        ({"is_bare": True, "seconds": Counter(no_pose=9)}, "no frames: a log alone; no pose in 9 s, else 9 no_pose"),
    ],
)
def test_nothing_to_use(values: dict[str, object], words: str) -> None:
    assert not outcome(**values).is_useful and str(outcome(**values)).startswith(words)


def test_a_log_alone_is_of_use_for_its_poses() -> None:
    assert outcome(is_bare=True, has_table=False).is_useful


def test_a_replay_of_which_nothing_could_be_used_fails(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    flight = new_flight(tmp_path / "flights", 0.0)
    shutil.copytree(CUT, flight, dirs_exist_ok=True)
    rows = (CUT / "frames.csv").read_text().splitlines()
    (flight / "frames.csv").write_text("\n".join([rows[0], "1,00014", "2,00015"]))
    arguments = ["distloc", "replay", str(tmp_path / "flights"), "--out", str(tmp_path / "out")]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as ended:
        main()
    out, err = capfd.readouterr()
    assert ended.value.code == 1
    assert "holds 1 flights" in out and flight.name in out
    (line,) = err.splitlines()
    assert "nothing could be used: 0 of 2 frames used, not used: 2" in line and "poses in" in line


def test_masks_that_the_config_leaves_aside_are_told(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recording of masks alone, replayed by a segmenter that wants pictures."""
    copy = Path(shutil.copytree(CUT, tmp_path / "copy"))
    text = (copy / "config.toml").read_text()
    assert 'kind = "recorded"' in text
    (tmp_path / "c.toml").write_text(text.replace('kind = "recorded"', ""))
    arguments = ["distloc", "replay", str(copy), "--out", str(tmp_path / "out"), "--config", str(tmp_path / "c.toml")]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit):
        main()
    (line,) = capfd.readouterr().err.splitlines()
    assert "bad_frame" in line and "segmenter.kind = 'recorded'" in line


def test_pictures_from_before_and_after_the_log_are_not_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = Path(shutil.copytree(CUT, tmp_path / "copy"))
    (copy / "frames").mkdir()
    rows = [line.split(",") for line in (copy / "frames.csv").read_text().splitlines()[1:]]
    first_us, last_us = int(rows[0][0]), int(rows[-1][0])
    outside = [(first_us - n * 10**6, f"early{n}") for n in range(1, 200)]
    outside += [(last_us + n * 10**6, f"late{n}") for n in range(60, 260)]
    (copy / "frames.csv").write_text(
        "stamp_us,file\n" + "".join(f"{us},{name}\n" for us, name in outside + [(int(a), b) for a, b in rows])
    )
    recording = Recording(copy)
    loaded: list[str] = []
    monkeypatch.setattr(recording, "load_picture", lambda name, most_pixels: loaded.append(name))
    posed = PosedFrames(recording, load_config(copy / "config.toml"))
    given = [frame.name for frame, _ in posed.pairs(lambda stamp_ns: None)]
    assert set(given) <= set(loaded) and len(given) > 50
    assert not [name for name in loaded if name.startswith(("early1", "late1"))]
    assert posed.gate.rejects.total() + len(given) == len(rows) + len(outside)


def test_a_picture_larger_than_the_camera_is_refused_by_its_header(tmp_path: Path) -> None:
    copy = Path(shutil.copytree(CUT, tmp_path / "copy"))
    (copy / "frames").mkdir()
    config: Config = load_config(copy / "config.toml")
    rows = [line.split(",") for line in (copy / "frames.csv").read_text().splitlines()[1:]]
    data = bytearray(cv2.imencode(".png", np.zeros((4, 6, 3), np.uint8))[1].tobytes())
    data[16:24] = (32_000).to_bytes(4, "big") * 2
    for _, name in rows[60:65]:
        (copy / "frames" / f"{name}.png").write_bytes(data)
    posed = PosedFrames(Recording(copy), config)
    count = sum(1 for _ in posed.pairs(lambda stamp_ns: None))
    assert posed.gate.rejects["bad_frame"] == 5 and count > 50  # type: ignore[index]
