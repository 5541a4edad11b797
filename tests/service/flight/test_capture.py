"""A camera that does not fit the config ends the service at its start, and nothing once it flies."""

import asyncio
from collections import Counter
from collections.abc import Callable

import pytest

from distloc.types import RejectReason
from service.camera.sources import SourceError
from service.common.messages import Frame
from service.flight.capture import Capture
from tests.support.running_app import run, until


class WrongAtFirst:
    """A source whose first frame has another size than the config says, then frames that fit, then its end."""

    def __init__(self) -> None:
        self.rejected: Counter[RejectReason] = Counter()
        self.reads = 0

    def __enter__(self) -> "WrongAtFirst":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def read(self) -> Frame | None:
        self.reads += 1
        if self.reads == 1:
            raise SourceError("camera.width, camera.height are 1920 x 1080: the source gives 640 x 480")
        return None if self.reads > 3 else Frame(self.reads, str(self.reads), None)

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("since_start_s", "is_resuming", "ends"),
    [(0.0, False, True), (29.0, False, True), (31.0, False, False), (3600.0, False, False), (0.0, True, False)],
)
def test_only_at_the_start_it_ends_the_service(since_start_s: float, is_resuming: bool, ends: bool) -> None:
    async def body() -> None:
        taken: list[Frame] = []
        ended = asyncio.Event()
        source = WrongAtFirst()
        capture = Capture(source, taken.append, ended.set, is_resuming, clock_from(since_start_s))
        capture.start()
        if ends:
            await ended.wait()
            assert "640 x 480" in str(capture.error) and not taken
        else:
            await until(lambda: len(taken) == 2, "the frames after it")
            assert capture.error is None and not ended.is_set()
        capture.stop()
        await capture.close()

    run(body())


def clock_from(since_start_s: float) -> Callable[[], float]:
    """0 when the capture is made, then the time given."""
    times = iter([0.0])
    return lambda: next(times, since_start_s)
