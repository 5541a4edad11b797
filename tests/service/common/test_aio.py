"""asyncio's groups and time limits, and the package that stands in for them on Python 3.10: one behaviour."""

import asyncio
import runpy
import sys
from types import SimpleNamespace

import pytest

from service.common import aio
from tests.support.places import ROOT


@pytest.fixture(params=["of this Python", "of 3.10"])
def chosen(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    if request.param == "of 3.10":
        if sys.version_info >= (3, 13):
            pytest.skip("the package that stands in on 3.10 runs on Python 3.12 at the latest")
        monkeypatch.setattr(sys, "version_info", (3, 10, 12))
        return SimpleNamespace(**runpy.run_path(str(ROOT / "service/common/aio.py")))
    return SimpleNamespace(run=aio.run, TaskGroup=aio.TaskGroup, timeout=aio.timeout)


async def for_ever() -> None:
    await asyncio.Event().wait()


async def failing() -> None:
    raise OSError("the link")


def test_one_that_fails_ends_the_others_and_the_body(chosen: SimpleNamespace) -> None:
    ended: list[asyncio.Task[None]] = []

    async def body() -> str:
        try:
            async with chosen.TaskGroup() as group:
                ended.append(group.create_task(for_ever(), name="link"))
                group.create_task(failing())
                await for_ever()
        except Exception as error:
            first = error.exceptions[0]  # type: ignore[attr-defined]
            await asyncio.sleep(0)  # the cancellation of the body was the group's own and is over
            return f"{type(error).__name__}: {type(first).__name__}: {first}"
        return "no error"

    assert chosen.run(body()) == "ExceptionGroup: OSError: the link"
    assert ended[0].cancelled() and ended[0].get_name() == "link"


def test_tasks_that_are_cancelled_one_by_one_end_the_group_without_an_error(chosen: SimpleNamespace) -> None:
    async def body() -> str:
        async with chosen.TaskGroup() as group:
            tasks = [group.create_task(for_ever()) for _ in range(3)]
            await asyncio.sleep(0)
            for task in tasks:
                task.cancel()
        return "closed"

    assert chosen.run(body()) == "closed"


def test_a_time_limit_raises_the_builtin_error_and_leaves_the_task_well(chosen: SimpleNamespace) -> None:
    async def body() -> str:
        with pytest.raises(TimeoutError):
            async with chosen.timeout(0.0):
                await for_ever()
        async with chosen.timeout(3600.0):
            await asyncio.sleep(0)
        return "well"

    assert chosen.run(body()) == "well"


@pytest.mark.parametrize("in_group", [False, True])
def test_a_cancellation_that_meets_a_time_limit_is_not_lost(chosen: SimpleNamespace, in_group: bool) -> None:
    """As the link's connecting: the limit ends and the flight is over in one round of the loop."""

    async def limited() -> None:
        while True:
            try:
                async with chosen.timeout(0.0):
                    await for_ever()
            except TimeoutError:
                await for_ever()

    async def body() -> bool:
        if in_group:
            async with chosen.TaskGroup() as group:
                task = group.create_task(limited())
                asyncio.get_running_loop().call_soon(task.cancel)
            return bool(task.cancelled())
        task = asyncio.create_task(limited())
        asyncio.get_running_loop().call_soon(task.cancel)
        await asyncio.wait({task})
        return task.cancelled()

    assert chosen.run(body())


def test_a_group_within_a_group_ends_with_it(chosen: SimpleNamespace) -> None:
    """As the frame loop within the app: cancelled from outside, it is no error."""
    inner: list[asyncio.Task[None]] = []

    async def frames() -> None:
        async with chosen.TaskGroup() as group:
            inner.append(group.create_task(for_ever()))
            await for_ever()

    async def body() -> str:
        async with chosen.TaskGroup() as group:
            task = group.create_task(frames())
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            task.cancel()
        return "closed"

    assert chosen.run(body()) == "closed"
    assert inner[0].cancelled()
