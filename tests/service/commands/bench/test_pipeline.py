"""The bench's pipeline is the real one: an autopilot on UDP, the App, a zenoh subscriber in another process."""

import msgspec
import pytest

from service.commands.bench.service.pipeline import TARGETS, Pipeline, measure_pipeline


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    return measure_pipeline(2000, 25)


@pytest.mark.thorough
def test_frames_become_reports_here_and_in_another_process(pipeline: Pipeline) -> None:
    reported, heard = pipeline.frame_to_report, pipeline.frame_to_subscriber
    assert 5 <= reported.n <= 25  # told of after some steps
    assert heard.n + pipeline.unheard == TARGETS * reported.n
    assert heard.n > 0
    assert 0.0 < reported.p50_ms <= reported.p95_ms
    assert 0.0 < heard.p50_ms <= heard.p95_ms
    assert heard.p50_ms > reported.p50_ms  # they are heard after they are handed over
    assert msgspec.json.decode(msgspec.json.encode(pipeline), type=Pipeline) == pipeline


def test_the_autopilot_really_sends(pipeline: Pipeline) -> None:
    assert pipeline.messages_per_s > 20.0
