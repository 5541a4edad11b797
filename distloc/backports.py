"""Names that are newer than Python 3.10, for all of distloc; asyncio's are in service/common/aio.py."""

import sys

if sys.version_info >= (3, 11):
    from builtins import BaseExceptionGroup
    from enum import StrEnum
    from typing import Self

    import tomllib
else:
    from enum import Enum

    import tomli as tomllib
    from exceptiongroup import BaseExceptionGroup
    from typing_extensions import Self

    class StrEnum(str, Enum):
        """Members are their text, and are printed as it."""

        __str__ = str.__str__

        @staticmethod
        def _generate_next_value_(name: str, start: int, count: int, last_values: list[str]) -> str:
            return name.lower()


__all__ = ["BaseExceptionGroup", "Self", "StrEnum", "tomllib"]
