"""asyncio's names that are newer than Python 3.10: there the taskgroup package, CPython's own code, has them."""

import sys

if sys.version_info >= (3, 11):
    from asyncio import TaskGroup, run, timeout
else:
    from collections.abc import Coroutine
    from typing import Any, TypeVar

    from taskgroup import Runner, TaskGroup, timeout

    _T = TypeVar("_T")

    def run(main: Coroutine[Any, Any, _T]) -> _T:
        """As asyncio.run; its tasks count how often they were cancelled, which groups and timeouts go by."""
        with Runner() as runner:
            return runner.run(main)


__all__ = ["TaskGroup", "run", "timeout"]
