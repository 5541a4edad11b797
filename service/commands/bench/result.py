"""What `distloc bench --json` prints: each part's struct, and the limits that the project sets itself beside them."""

import msgspec

from service.commands.bench.filters.filter_step import FilterCost
from service.commands.bench.filters.literal_update import LiteralUpdate
from service.commands.bench.filters.targets import TargetsCost
from service.commands.bench.ground.cost import LONG_S, GroundCost
from service.commands.bench.machine import Machine
from service.commands.bench.published.compared import ENOUGH_HOLDS, Published
from service.commands.bench.service.pipeline import Pipeline
from service.commands.bench.service.scenery import SceneryCost
from service.commands.bench.service.service_cost import ServiceCost
from service.commands.bench.service.stages import MaskCost, Stages
from service.commands.bench.timing import ratio

_STEP_MS = {1: 4.0, 4: 6.0, 16: 10.0, 64: 25.0}  # by how many targets


class Limit(msgspec.Struct, frozen=True):
    """One of them; `is_most` tells whether less or more is better. Null and not held where nothing was measured."""

    name: str
    limit: float
    unit: str
    is_most: bool
    measured: float | None
    is_held: bool | None


class Bench(msgspec.Struct, frozen=True):
    """A part that was not run is null."""

    machine: Machine
    limits: tuple[Limit, ...]
    filter: FilterCost | None = None
    targets: tuple[TargetsCost, ...] | None = None
    literal: LiteralUpdate | None = None
    published: Published | None = None
    stages: Stages | None = None
    scenery: SceneryCost | None = None
    pipeline: Pipeline | None = None
    service: ServiceCost | None = None
    ground: GroundCost | None = None
    schema: str = "distloc/bench/2"


def with_limits(result: Bench) -> Bench:
    """The same with its limits worked out from what was measured."""
    limits = (
        *_of_filter(result.filter),
        *_of_targets(result.targets),
        *_of_literal(result.literal),
        *_of_published(result.published),
        *_of_stages(result.stages),
        *_of_scenery(result.scenery),
        *_of_pipeline(result.pipeline),
        *_of_service(result.service),
        *_of_ground(result.ground),
    )
    return msgspec.structs.replace(result, limits=limits)


def _most(name: str, limit: float, unit: str, measured: float | None) -> Limit:
    return Limit(name, limit, unit, True, measured, None if measured is None else measured < limit)


def _least(name: str, limit: float, unit: str, measured: float | None) -> Limit:
    return Limit(name, limit, unit, False, measured, None if measured is None else measured >= limit)


def _of_filter(cost: FilterCost | None) -> tuple[Limit, ...]:
    if cost is None:
        return ()
    step_ms = next(one.calibrated.median_ms for one in cost.steps if one.n_particles == cost.limit_particles)
    return (
        _most("filter step, one target", 3.0, "ms", step_ms),
        _most("filter step by reading and writing its state once", 6.0, "times", cost.by_state_once),
        _most("allocated in a filter step, at the peak", 256.0, "KB", cost.traced_peak_kb),
    )


def _of_targets(costs: tuple[TargetsCost, ...] | None) -> tuple[Limit, ...]:
    return tuple(
        _most(f"whole step, targets: {one.targets}", _STEP_MS[one.targets], "ms", one.step.median_ms)
        for one in costs or ()
        if one.targets in _STEP_MS
    )


def _of_literal(literal: LiteralUpdate | None) -> tuple[Limit, ...]:
    return () if literal is None else (_least("faster than the literal update", 300.0, "times", literal.literal.ratio),)


def _of_published(published: Published | None) -> tuple[Limit, ...]:
    if published is None:
        return ()
    installed = [rival.step.median_ms for rival in published.rivals if rival.step is not None]
    best = ratio(min(installed), published.calibrated.median_ms) if installed else None
    (theirs,) = (one for one in published.rivals if one.library == "particles")
    as_near = None
    if theirs.step is not None and theirs.error_m is not None:
        is_as_near = published.enough_worst_m <= theirs.error_m and published.enough_holds >= ENOUGH_HOLDS
        as_near = ratio(theirs.step.median_ms, published.enough.median_ms) if is_as_near else 0.0
    return (
        _least("faster than the best published library", 5.0, "times", best),
        _least("faster than `particles`, no farther off, truth held", 15.0, "times", as_near),
    )


def _of_stages(stages: Stages | None) -> tuple[Limit, ...]:
    if stages is None:
        return ()
    full_hd = [one for one in stages.masks if (one.width, one.height) == (1920, 1080)]
    worst: MaskCost = max(full_hd, key=lambda one: one.time.median_ms)
    return (_most(f"detections at full HD, the slowest mask ({worst.mask})", 4.0, "ms", worst.time.median_ms),)


def _of_scenery(cost: SceneryCost | None) -> tuple[Limit, ...]:
    if cost is None:
        return ()
    return (
        _most("corners of a frame, median", 6.0, "ms", cost.track.p50_ms),
        _most("a keyframe's solution, median", 15.0, "ms", cost.keyframe.p50_ms),
    )


def _of_pipeline(pipeline: Pipeline | None) -> tuple[Limit, ...]:
    if pipeline is None:
        return ()
    counted, heard = pipeline.frame_to_report.n, pipeline.frame_to_subscriber.n
    reports = max(counted * pipeline.targets, 1)
    return (
        _most("frame to report, 95th percentile", 30.0, "ms", pipeline.frame_to_report.p95_ms),
        _most("frame to another process, 95th percentile", 40.0, "ms", pipeline.frame_to_subscriber.p95_ms),
        _least("frames with reports of all targets", 90.0, "%", round(100.0 * counted / pipeline.frames, 1)),
        _least("reports heard", 99.0, "%", round(100.0 * heard / reports, 1)),
    )


def _of_service(cost: ServiceCost | None) -> tuple[Limit, ...]:
    if cost is None:
        return ()
    return (
        _most("500 messages/s", 8.0, "% of a core", round(100.0 * cost.messages_cpu, 2)),
        _most("idle", 5.0, "% of a core", round(100.0 * cost.idle_cpu, 2)),
        _most("ready", 3.0, "s", cost.ready_s),
        _most("--help", 0.3, "s", cost.help_s),
        _most("memory at work, at the most", 200.0, "MB", cost.peak_rss_mb),
    )


def _of_ground(cost: GroundCost | None) -> tuple[Limit, ...]:
    if cost is None:
        return ()
    slope_mb = cost.rss_mb_per_hour if cost.seconds >= LONG_S else None
    return (
        _most(
            f"the ground at {cost.reports_hz:.0f} reports/s", 50.0, "% of a core", round(100.0 * cost.cpu_watched, 2)
        ),
        _most("the ground's memory, over five minutes and more", 12.0, "MB/h", slope_mb),
        _most(f"report to {cost.screen}, 95th percentile", 300.0, "ms", cost.put_to_screen.p95_ms),
        _most("late joiner", 2.0, "s", cost.late_joiner_s),
        _least("the map while it moves", 30.0, "frames/s", cost.frames_hz),
    )
