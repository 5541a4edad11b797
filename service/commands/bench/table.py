"""The bench's result for people: a group of lines for each part, the limits at the end."""

from collections.abc import Callable, Iterator
from typing import TypeVar

from service.commands.bench.filters.filter_step import FilterCost
from service.commands.bench.filters.literal_update import LiteralUpdate
from service.commands.bench.filters.targets import TargetsCost
from service.commands.bench.ground.cost import GroundCost
from service.commands.bench.machine import Machine
from service.commands.bench.published.compared import Published, Rival
from service.commands.bench.result import Bench, Limit
from service.commands.bench.service.pipeline import Latency, Pipeline
from service.commands.bench.service.scenery import SceneryCost
from service.commands.bench.service.service_cost import ServiceCost
from service.commands.bench.service.stages import Stages
from service.commands.bench.timing import Figure

_NAME = 52
Part = TypeVar("Part")


def table(result: Bench) -> str:
    """Lines under 100 columns."""
    lines = [*_machine(result.machine)]
    for lines_of_part in (
        _shown(result.filter, _filter),
        _shown(result.targets, _targets),
        _shown(result.literal, _literal),
        _shown(result.published, _published),
        _shown(result.stages, _stages),
        _shown(result.scenery, _scenery),
        _shown(result.pipeline, _pipeline),
        _shown(result.service, _service),
        _shown(result.ground, _ground),
    ):
        lines += lines_of_part
    return "\n".join([*lines, "", "limits", *(_limit(one) for one in result.limits)])


def _shown(part: Part | None, show: Callable[[Part], Iterator[str]]) -> list[str]:
    return [] if part is None else ["", *show(part)]


def _head(title: str, compared: str) -> str:
    return f"{title:{_NAME}}{'ms':>10}{compared:>16}{'n':>6}"


def _line(name: str, figure: Figure) -> str:
    return f"{'  ' + name:{_NAME}}{figure.median_ms:10.3f}{figure.ratio:16.2f}{figure.n:6d}"


def _machine(machine: Machine) -> Iterator[str]:
    yield f"{machine.cpu}, {machine.cores} cores, {machine.memory_gb:.1f} GB"
    yield f"Python {machine.python}, NumPy {machine.numpy}, OpenCV {machine.opencv}"
    yield (
        f"one thread reads and writes {machine.memory_gb_per_s:.1f} GB/s in {machine.big_copy_mb:.0f} MB, "
        f"{machine.state_sized_gb_per_s:.1f} GB/s in {machine.state_copy_mb:.1f} MB"
    )
    yield f"fixed NumPy work at 100,000 particles: {machine.fixed_work_ms:.2f} ms"


def _filter(cost: FilterCost) -> Iterator[str]:
    yield _head("filter step, one target", "calibrated = 1")
    for one in cost.steps:
        yield _line(f"calibrated, {one.n_particles:,}: {one.calibrated_ns_per_particle:.1f} ns each", one.calibrated)
        for name, figure in (("with", one.with_resampling), ("without", one.without_resampling)):
            if figure is not None:
                yield _line(f"  {name} resampling", figure)
        yield _line(f"bootstrap, {one.n_particles:,}: {one.bootstrap_ns_per_particle:.1f} ns each", one.bootstrap)
    yield (
        f"  its state at {cost.limit_particles:,}, {cost.state_bytes / 1e6:.2f} MB, is read and written once in "
        f"{cost.state_once_ms:.3f} ms: a step is {cost.by_state_once:.1f} times that"
    )
    yield (
        f"  at the bandwidth of an array of its size, in {cost.state_once_in_cache_ms:.3f} ms: "
        f"{cost.by_state_once_in_cache:.1f} times that"
    )
    yield f"  a step allocates at most {cost.traced_peak_kb:.0f} KB ({cost.traced_steps} steps)"


def _targets(costs: tuple[TargetsCost, ...]) -> Iterator[str]:
    yield _head("whole localizer step on a full HD mask", "first = 1")
    for one in costs:
        yield _line(f"{one.targets} target{'s' * (one.targets != 1)}", one.step)


def _literal(literal: LiteralUpdate) -> Iterator[str]:
    yield _head("the paper's update taken literally", "calibrated = 1")
    yield _line(f"calibrated, whole step, {literal.n_particles:,}", literal.calibrated)
    yield _line(f"weights against all {literal.positive_pixels:,} positive pixels", literal.literal)
    if literal.timed_particles < literal.n_particles:
        yield f"  (timed on {literal.timed_particles:,} particles and scaled up: all would take too long)"


def _published(published: Published) -> Iterator[str]:
    yield _head(f"the bootstrap step by published libraries, {published.n_particles:,}", "calibrated = 1")
    yield _line(f"distloc calibrated, ended {published.calibrated_error_m:.0f} m off", published.calibrated)
    few = f"distloc calibrated, {published.enough_particles:,}, exact poses, {published.enough_worst_m:.0f} m at most"
    yield _line(few, published.enough)
    yield _line(f"distloc bootstrap, {published.bootstrap_error_m:.0f} m", published.bootstrap)
    for rival in published.rivals:
        yield _rival(rival)
    yield "  the libraries are handed each frame's chamfer map, which distloc's bootstrap makes itself;"
    yield "  they and it resample at each step, the calibrated filter where it must: 3 of 100"


def _rival(rival: Rival) -> str:
    if rival.step is None or rival.error_m is None:
        return f"  {rival.library:16}not installed (pip install '.[bench]')"
    return _line(f"{rival.library} {rival.version}, {rival.error_m:.0f} m", rival.step)


def _stages(stages: Stages) -> Iterator[str]:
    yield _head("stages", "fixed work = 1")
    for mask in stages.masks:
        name = f"detections {mask.width}x{mask.height}, {mask.mask}: {mask.detections}"
        yield _line(name, mask.time)
    for one in stages.segmenters:
        yield _line(f"segmenter {one.width}x{one.height}, {one.segmenter}", one.time)
    decoding = stages.framer_and_decoder
    yield _line(f"framer and decoder, {decoding.messages} messages", decoding.round)
    yield f"    {decoding.us_per_message:.1f} us a message, {decoding.messages_per_s:,.0f} messages/s"
    yield _line(f"100 poses looked up, {stages.pose_us:.0f} us each", stages.hundred_poses)


def _scenery(cost: SceneryCost) -> Iterator[str]:
    yield "the scenery as a compass, 1280x720, drawn hills"
    yield f"{'':{_NAME}}{'p50 ms':>10}{'p95 ms':>16}{'n':>6}"
    yield _latency("corners of a frame", cost.track)
    yield _latency(f"a keyframe's solution, {cost.corners} places in the last", cost.keyframe)
    yield f"  a heading that is 2 deg off is measured to {cost.heading_off_deg:+.2f} deg"


def _pipeline(pipeline: Pipeline) -> Iterator[str]:
    yield (
        f"pipeline beside the segmenter, {pipeline.targets} targets, {pipeline.n_particles:,} particles each, "
        f"{pipeline.messages_per_s:.0f} messages/s"
    )
    yield f"{'':{_NAME}}{'p50 ms':>10}{'p95 ms':>16}{'n':>6}"
    yield _latency("frame to its reports", pipeline.frame_to_report)
    yield _latency("frame to a zenoh subscriber in another process", pipeline.frame_to_subscriber)
    if pipeline.unheard:
        yield f"  {pipeline.unheard} reports were not heard"


def _latency(name: str, latency: Latency) -> str:
    return f"{'  ' + name:{_NAME}}{latency.p50_ms:10.1f}{latency.p95_ms:16.1f}{latency.n:6d}"


def _service(cost: ServiceCost) -> Iterator[str]:
    yield "the service in a process of its own"
    yield f"  CPU at {cost.messages_hz:.0f} messages/s {100 * cost.messages_cpu:.1f} % of a core"
    yield f"  CPU when idle {100 * cost.idle_cpu:.1f} %"
    yield (
        f"  memory with the shipped model {cost.ready_rss_mb:.0f} MB once ready, "
        f"{cost.work_rss_mb:.0f} MB at work with {cost.targets} targets (peak {cost.peak_rss_mb:.0f})"
    )
    yield f"  ready in {cost.ready_s:.2f} s; --help in {cost.help_s:.2f} s"


def _ground(cost: GroundCost) -> Iterator[str]:
    yield f"the ground with {cost.drones} drones of {cost.fires} fires each, {cost.reports_hz:.0f} reports/s"
    yield f"  CPU {100 * cost.cpu:.1f} % of a core, {100 * cost.cpu_watched:.1f} % while it is watched"
    yield (
        f"  memory {cost.rss_mb:.0f} MB after {cost.seconds:.0f} s (peak {cost.peak_rss_mb:.0f}), "
        f"{cost.rss_mb_per_hour:+.1f} MB/h in their second half"
    )
    where = "the screen of a Chromium" if cost.screen == "chromium" else "a page's WebSocket: no Chromium is installed"
    yield f"  watched on {where}"
    yield f"{'':{_NAME}}{'p50 ms':>10}{'p95 ms':>16}{'n':>6}"
    yield _latency("a drone's report to there", cost.put_to_screen)
    if cost.unseen:
        yield f"  {cost.unseen} reports were not seen"
    yield f"  a late joiner has everything in {cost.late_joiner_s:.2f} s"
    if cost.frames_hz is not None:
        yield f"  {cost.frames_hz:.1f} frames/s while the map moves"


def _limit(one: Limit) -> str:
    bound = f"{'under' if one.is_most else 'at least'} {one.limit:g} {one.unit}"
    verdict = "not measured" if one.is_held is None else "held" if one.is_held else "NOT held"
    measured = "" if one.measured is None else f"{one.measured:.4g}"
    return f"  {one.name:{_NAME}}{measured:>8}  {bound:24}{verdict}"
