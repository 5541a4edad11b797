"""Runs the parts that are asked for, one after the other, and prints what they measured; called by the command."""

import contextlib
import logging
from collections.abc import Callable, Collection, Iterator
from typing import Literal, get_args

import msgspec

from distloc.filter.settings import ENOUGH_PARTICLES
from service.commands.bench.filters.filter_step import COUNTS, PAPER_COUNT, measure_filter, state_bytes
from service.commands.bench.filters.literal_update import BUDGET_S, measure_literal
from service.commands.bench.filters.targets import COUNTS as TARGETS
from service.commands.bench.filters.targets import measure_targets
from service.commands.bench.ground.cost import SECONDS, STEPS, is_ground_installed, measure_ground
from service.commands.bench.machine import Machine, measure_machine
from service.commands.bench.published.compared import measure_published
from service.commands.bench.result import Bench, with_limits
from service.commands.bench.service.pipeline import FRAMES, measure_pipeline
from service.commands.bench.service.scenery import FRAMES as SCENERY_FRAMES
from service.commands.bench.service.scenery import measure_scenery
from service.commands.bench.service.service_cost import service_cost
from service.commands.bench.service.stages import measure_stages
from service.commands.bench.table import table
from service.commands.progress import count_progress

Part = Literal["filter", "targets", "literal", "published", "stages", "scenery", "pipeline", "service", "ground"]
PARTS: tuple[Part, ...] = get_args(Part)


class Sizes(msgspec.Struct, frozen=True):
    """How much is measured; `number` frames of the flight's 101. A test takes less."""

    n_particles: int = PAPER_COUNT
    counts: tuple[int, ...] = COUNTS
    number: int = 101
    targets: tuple[int, ...] = TARGETS
    target_frames: int = 61
    literal_budget_s: float = BUDGET_S
    rounds: int = 50
    segmenter_rounds: int = 7
    scenery_frames: int = SCENERY_FRAMES
    pipeline_frames: int = FRAMES
    service_s: float = 10.0
    ground_s: float = SECONDS


def parts_of(names: Collection[str]) -> tuple[Part, ...]:
    """The parts of these names, all that can be measured if there are none; ValueError for a name that is no part's."""
    for name in names:
        if name not in PARTS:
            raise ValueError(f"a part is one of {', '.join(PARTS)}, got {name!r}")
    possible = tuple(part for part in PARTS if part != "ground" or is_ground_installed())
    return tuple(part for part in PARTS if part in names) or possible


def run_bench(as_json: bool, only: Collection[Part], say: Callable[[str], None], sizes: Sizes | None = None) -> None:
    """Measure these parts, and print them as a table or as JSON."""
    logging.getLogger().setLevel(logging.WARNING)
    result = bench(only, sizes)
    say(msgspec.json.encode(result).decode() if as_json else table(result))


def bench(only: Collection[Part] = PARTS, sizes: Sizes | None = None) -> Bench:
    """The machine, these parts in their order, and the limits."""
    sizes = sizes or Sizes()
    machine = measure_machine(state_bytes(sizes.n_particles), min(30, sizes.rounds))
    result = Bench(machine=machine, limits=())
    for part in PARTS:
        if part in only:
            with _progress(part, sizes) as on_step:
                result = _with_part(result, part, machine, sizes, on_step)
    return with_limits(result)


def _with_part(result: Bench, part: Part, machine: Machine, sizes: Sizes, on_step: Callable[[], None]) -> Bench:
    measured: object
    match part:
        case "filter":
            measured = measure_filter(machine, sizes.counts, sizes.number, on_step)
        case "targets":
            few = min(sizes.n_particles, ENOUGH_PARTICLES)
            measured = measure_targets(few, sizes.targets, sizes.target_frames, on_step)
        case "literal":
            measured = measure_literal(sizes.n_particles, sizes.number, sizes.literal_budget_s, on_step)
        case "published":
            measured = measure_published(sizes.n_particles, sizes.number, on_step)
        case "stages":
            measured = measure_stages(sizes.rounds, sizes.segmenter_rounds, on_step)
        case "scenery":
            measured = measure_scenery(sizes.scenery_frames, on_step)
        case "pipeline":
            measured = measure_pipeline(min(sizes.n_particles, ENOUGH_PARTICLES), sizes.pipeline_frames, on_step)
        case "service":
            measured = service_cost(sizes.service_s)
            on_step()
        case "ground":
            measured = measure_ground(seconds=sizes.ground_s, on_step=on_step)
    return msgspec.structs.replace(result, **{part: measured})


@contextlib.contextmanager
def _progress(part: Part, sizes: Sizes) -> Iterator[Callable[[], None]]:
    """A bar for one part; calls of `on_step` move it."""
    steps = {
        "filter": (len(sizes.counts) + 1) * (sizes.number - 1),
        "targets": sizes.target_frames,
        "stages": 3,
        "scenery": sizes.scenery_frames,
        "pipeline": sizes.pipeline_frames,
        "service": 1,
        "ground": STEPS,
    }
    with count_progress(f"bench: {part}", steps.get(part, sizes.number - 1)) as on_done:
        done = 0

        def on_step() -> None:
            nonlocal done
            done += 1
            on_done(done)

        yield on_step
