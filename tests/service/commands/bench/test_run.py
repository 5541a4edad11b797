"""The bench says what it measured: JSON that decodes to its struct, ratios that are those of the medians it prints."""

import socket
import sys
import tracemalloc

import msgspec
import pytest
from msgspec.structs import replace

from service.commands.bench.filters.filter_step import Calibrated, FilterCost, Traced
from service.commands.bench.filters.targets import measure_targets
from service.commands.bench.result import Bench, with_limits
from service.commands.bench.run import PARTS, Part, Sizes, bench, parts_of, run_bench
from service.commands.bench.scene import fly
from service.commands.bench.table import table
from service.commands.bench.timing import Figure, in_turns
from service.commands.cli import main

SMALL = Sizes(
    n_particles=2000,
    counts=(200, 2000),
    number=11,
    targets=(1, 4),
    target_frames=15,
    rounds=2,
    segmenter_rounds=1,
    scenery_frames=30,
)
QUICK: tuple[Part, ...] = ("filter", "targets", "literal", "published", "stages", "scenery")


@pytest.fixture(scope="module")
def result() -> Bench:
    return bench(QUICK, SMALL)


def test_json_decodes_to_what_was_measured(result: Bench) -> None:
    said: list[str] = []
    run_bench(True, ("stages",), said.append, SMALL)
    decoded = msgspec.json.decode(said[0], type=Bench, strict=True)
    assert decoded.schema == "distloc/bench/2"
    assert decoded.stages is not None
    assert all(getattr(decoded, part) is None for part in PARTS if part != "stages")
    assert msgspec.json.decode(msgspec.json.encode(result), type=Bench) == result


def test_every_time_is_positive_and_counted(result: Bench) -> None:
    found = figures(msgspec.to_builtins(result))
    assert len(found) > 25
    assert all(one["median_ms"] > 0 and one["ratio"] > 0 and one["n"] > 0 for one in found)


def test_the_scenery_is_followed_and_measures(result: Bench) -> None:
    cost = result.scenery
    assert cost is not None and cost.track.n == 30 and cost.keyframe.n >= 5
    assert 0.0 < cost.track.p50_ms <= cost.track.p95_ms and cost.keyframe.p50_ms > 0.0
    assert cost.corners > 20 and abs(cost.heading_off_deg) < 1.5
    assert {"corners of a frame, median", "a keyframe's solution, median"} <= {one.name for one in result.limits}


def test_ratios_are_those_of_the_medians(result: Bench) -> None:
    assert result.filter and result.literal and result.published and result.stages and result.targets
    pairs: list[tuple[Figure | None, float]] = []
    for step in result.filter.steps:
        unit_ms = step.calibrated.median_ms
        pairs += [(one, unit_ms) for one in (step.calibrated, step.bootstrap, step.without_resampling)]
    pairs += [(one.step, result.targets[0].step.median_ms) for one in result.targets]
    pairs.append((result.literal.literal, result.literal.calibrated.median_ms))
    published = result.published
    pairs += [(one, published.calibrated.median_ms) for one in (published.bootstrap, published.enough)]
    pairs += [(rival.step, published.calibrated.median_ms) for rival in published.rivals]
    stages = result.stages
    pairs += [(mask.time, stages.fixed_image_work_ms) for mask in stages.masks]
    pairs += [(stages.framer_and_decoder.round, stages.fixed_bytes_work_ms)]
    checked = [(one.ratio, one.median_ms / unit_ms) for one, unit_ms in pairs if one is not None]
    assert len(checked) > 18
    assert [ratio for ratio, _ in checked] == pytest.approx([expected for _, expected in checked], abs=1e-4)


def test_the_state_is_compared_with_the_bandwidth_measured(result: Bench) -> None:
    cost, machine = result.filter, result.machine
    assert cost is not None
    assert cost.limit_particles == 2000
    assert cost.state_bytes == 2000 * 9 * 4  # three of position, five nuisances, a weight; float32
    assert cost.state_once_ms == pytest.approx(2 * 72_000 / (machine.memory_gb_per_s * 1e9) * 1e3, abs=1e-4)
    step = cost.steps[-1].calibrated
    assert cost.by_state_once == pytest.approx(step.median_ms / cost.state_once_ms, rel=1e-3)
    for count in cost.steps:
        expected_ns = count.calibrated.median_ms / count.n_particles * 1e6
        assert count.calibrated_ns_per_particle == pytest.approx(expected_ns, abs=0.01)


def test_every_target_is_stepped() -> None:
    costs = measure_targets(500, (1, 4), 12)
    assert [one.targets for one in costs] == [1, 4]
    assert all(one.step.n >= 8 for one in costs)  # told of after 4 frames


def test_what_a_step_allocates_is_traced() -> None:
    class Wasteful(Calibrated):
        def step(self, seen: object) -> None:
            bytearray(3_000_000)

    peaks: list[int] = []
    ours: list[int] = []
    tracemalloc.start()
    fly({"wasteful": Traced(Wasteful(100), peaks), "ours": Traced(Calibrated(100), ours)}, 4)
    tracemalloc.stop()
    assert len(peaks) == 3
    assert all(3_000_000 <= peak < 3_100_000 for peak in peaks)
    assert all(0 < peak < 1_000_000 for peak in ours)


def test_in_turns_takes_every_work_in_every_round() -> None:
    calls: list[str] = []
    times_s = in_turns({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 3, warm_up=1)
    assert calls == ["a", "b"] * 4
    assert [len(times) for times in times_s.values()] == [3, 3]


def test_limits_are_held_or_not(result: Bench) -> None:
    assert result.filter is not None

    def verdicts(cost: FilterCost) -> list[bool | None]:
        return [one.is_held for one in with_limits(replace(result, filter=cost)).limits[:3]]

    steps = tuple(replace(one, calibrated=Figure(2.9, 1.0, 5)) for one in result.filter.steps)
    good = replace(result.filter, steps=steps, by_state_once=5.9, traced_peak_kb=255.0)
    slow = tuple(replace(one, calibrated=Figure(3.1, 1.0, 5)) for one in result.filter.steps)
    bad = replace(result.filter, steps=slow, by_state_once=6.1, traced_peak_kb=257.0)
    assert verdicts(good) == [True, True, True]
    assert verdicts(bad) == [False, False, False]


def test_table_has_every_part_and_says_what_is_not_held(result: Bench) -> None:
    assert result.published is not None
    missing = tuple(replace(one, version=None, step=None, error_m=None) for one in result.published.rivals)
    text = table(with_limits(replace(result, published=replace(result.published, rivals=missing))))
    for words in (
        result.machine.cpu,
        "calibrated, 2,000",
        "bootstrap, 200",
        "4 targets",
        "positive pixels",
        "half filled",
        "segmenter 1280x720, classical",
        "messages/s",
    ):
        assert words in text
    for library in ("particles", "stonesoup", "filterpy"):
        assert f"{library:16}not installed (pip install '.[bench]')" in text
    assert "not measured" in text  # the best of no libraries
    assert "NOT held" in text
    assert max(len(line) for line in text.splitlines()) < 110


def test_the_machine_is_named_by_its_parts_alone(result: Bench) -> None:
    said = msgspec.json.encode(result.machine).decode()
    assert socket.gethostname() not in said
    assert result.machine.cores >= 1
    assert result.machine.memory_gb > 0.1
    assert 0.1 < result.machine.memory_gb_per_s < 2000.0


def test_parts() -> None:
    assert parts_of(()) == PARTS
    assert parts_of(["stages", "filter"]) == ("filter", "stages")
    with pytest.raises(ValueError, match=r"a part is one of filter, .*, got 'all'"):
        parts_of(["all"])


def test_an_unknown_part_is_a_wrong_use(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["distloc", "bench", "--only", "bogus"])
    with pytest.raises(SystemExit) as exit_:
        main()
    assert exit_.value.code == 2
    assert "bogus" in capsys.readouterr().err


def figures(node: object) -> list[dict[str, float]]:
    """Every median in the result."""
    if isinstance(node, dict):
        own = [node] if "median_ms" in node else []
        return own + [one for value in node.values() for one in figures(value)]
    if isinstance(node, list | tuple):
        return [one for value in node for one in figures(value)]
    return []
