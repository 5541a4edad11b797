"""A few seconds of fuzzing for each thing that reads what others wrote; tests/fuzz/run.py goes on for longer."""

import random
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.config.load import load_config
from service.config.sections import ConfigError
from service.ground.subscriber import line_from_report
from service.recordings.recording import Recording, RecordingError
from tests.fuzz import targets
from tests.fuzz.mutations import stream

bounded = settings(max_examples=150, deadline=None)
STATE = targets.State()
seeds = st.integers(0, 2**32)  # of a generator of our own: hypothesis's is slow for thousands of draws


@bounded
@given(st.binary(max_size=2000), seeds)
def test_any_bytes_through_the_framer(data: bytes, seed: int) -> None:
    targets.Link().feed(random.Random(seed), data)


@bounded
@given(seeds)
def test_any_frames_through_framer_autopilot_and_commands(seed: int) -> None:
    rng, link = random.Random(seed), targets.Link()
    for _ in range(20):
        link.feed(rng, stream(rng))


def test_the_frames_that_are_fuzzed_do_arrive() -> None:
    rng, link = random.Random(0), targets.Link()
    for _ in range(500):
        link.feed(rng, stream(rng))
    assert len(link.autopilot.messages) >= 8 and link.signing.refused["wrong_signature"] > 0
    assert link.publisher.commands["taken"] > 0 and link.publisher.commands["refused"] > 0


@bounded
@given(seeds)
def test_any_config_is_taken_or_refused_in_one_line(seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        targets.config(Path(folder), targets.harmed_config(random.Random(seed)))


def test_the_config_that_is_harmed_is_sound(tmp_path: Path) -> None:
    assert targets.config(tmp_path, targets.README_CONFIG) is not None


@settings(bounded, max_examples=60)
@given(seeds)
def test_any_recording_is_read_or_refused_in_one_line(seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        targets.recording(Path(folder), targets.Flight().harmed(random.Random(seed)))


def test_the_recording_that_is_harmed_is_sound(tmp_path: Path) -> None:
    assert targets.recording(tmp_path, targets.Flight().files)


@bounded
@given(st.dictionaries(st.sampled_from([f"distloc.{key}" for key in targets.CARD]), st.text(max_size=30)), seeds)
def test_any_metadata_of_a_model_is_taken_or_refused_in_one_line(metadata: dict[str, str], seed: int) -> None:
    targets.card({**targets.harmed_card(random.Random(seed)), **metadata})


def test_the_metadata_that_is_harmed_is_sound() -> None:
    assert targets.card({f"distloc.{key}": value for key, value in targets.CARD.items()})


@bounded
@given(seeds)
def test_any_file_of_kept_targets_is_taken_or_refused(seed: int) -> None:
    targets.state(STATE.harmed(random.Random(seed)))


def test_the_state_that_is_harmed_is_sound_and_some_of_it_stays_so() -> None:
    assert targets.state(STATE.data) is not None
    taken = sum(targets.state(STATE.harmed(random.Random(seed))) is not None for seed in range(200))
    assert 0 < taken < 200


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("a = " + "[" * 100_000, "nested too deeply"),
        ("a = " + "9" * 10_000, "not TOML"),
        ("vehicle = '" + "x" * 100_000 + "'", "vehicle"),
        ("[segmenter]\nkind = '" + "x" * 100_000 + "'", "segmenter.kind"),
    ],
)
def test_what_fuzzing_found_in_configs(tmp_path: Path, text: str, names: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=names) as caught:
        load_config(path)
    assert len(str(caught.value)) < 1000


def test_a_stamp_behind_a_separator_that_only_strip_takes_for_a_space(tmp_path: Path) -> None:
    (tmp_path / "telemetry.tlog").write_bytes(b"\0")
    (tmp_path / "frames.csv").write_bytes(b"stamp_us,file\n\x1e100,a\n200\x1f,b\n\x1e100,c\n")
    recording = Recording(tmp_path)
    assert recording.frames() == [(100, "a"), (200, "b")] and recording.dropped == {"repeated_stamp": 1}


def test_json_that_is_nested_too_deeply(tmp_path: Path) -> None:
    nested = b'{"other":' * 100_000
    (tmp_path / "telemetry.tlog").write_bytes(b"\0")
    (tmp_path / "truth.json").write_bytes(nested)
    with pytest.raises(RecordingError, match=r"truth\.json"):
        Recording(tmp_path)
    assert line_from_report("k", nested).startswith("k no report")
