"""Has distloc see the standard library of Python 3.10 on any later one: what is newer is missing for our modules, and
for nobody else. What is newer in the language, and methods of classes, mypy and ruff know.
"""

import builtins
import sys
from collections.abc import Mapping, Sequence
from types import ModuleType

# Public names that 3.11 to 3.13 brought to modules that we use: dir() of each, less that of 3.10.
NEWER = {
    "asyncio": "Barrier BrokenBarrierError EventLoop QueueShutDown Runner TaskGroup Timeout timeout timeout_at"
    " create_eager_task_factory eager_task_factory taskgroups timeouts",
    "builtins": "BaseExceptionGroup ExceptionGroup PythonFinalizationError",
    "collections.abc": "Buffer",
    "contextlib": "chdir",
    "copy": "replace",
    "csv": "QUOTE_NOTNULL QUOTE_STRINGS",
    "datetime": "UTC",
    "enum": "CONFORM CONTINUOUS EJECT EnumCheck EnumDict EnumType FlagBoundary KEEP NAMED_FLAGS ReprEnum STRICT StrEnum"
    " UNIQUE global_enum global_enum_repr global_flag_repr global_str member nonmember property show_flag_values"
    " verify",
    "hashlib": "file_digest",
    "itertools": "batched",
    "logging": "getHandlerByName getHandlerNames getLevelNamesMapping",
    "math": "cbrt exp2 fma sumprod",
    "os": "login_tty process_cpu_count setns unshare timerfd_create timerfd_settime timerfd_gettime",
    "pathlib": "UnsupportedOperation",
    "queue": "ShutDown",
    "random": "binomialvariate",
    "re": "NOFLAG PatternError",
    "signal": "SIGSTKFLT",
    "statistics": "kde kde_random",
    "sys": "exception monitoring activate_stack_trampoline getunicodeinternedsize",
    "threading": "setprofile_all_threads settrace_all_threads",
    "types": "get_original_bases",
    "typing": "LiteralString Never NoDefault NotRequired ReadOnly Required Self TypeAliasType TypeIs TypeVarTuple"
    " Unpack assert_never assert_type clear_overloads dataclass_transform get_overloads get_protocol_members"
    " is_protocol override reveal_type",
}
_GONE = ("tomllib",)
_OURS = ("distloc", "service")
_import = builtins.__import__
_older: dict[str, ModuleType] = {}


def _as_of_3_10(name: str) -> ModuleType:
    """A module's copy that lacks what is newer."""
    if name not in _older:
        newer = NEWER.get(name, "").split()
        _older[name] = ModuleType(name)
        _older[name].__dict__.update({key: value for key, value in vars(sys.modules[name]).items() if key not in newer})
        if name == "sys":
            _older[name].__dict__["version_info"] = (3, 10, 12)
    return _older[name]


def _import_as_3_10(
    name: str,
    globals: Mapping[str, object] | None = None,
    locals: Mapping[str, object] | None = None,
    fromlist: Sequence[str] | None = (),
    level: int = 0,
) -> ModuleType:
    found = _import(name, globals, locals, fromlist or (), level)
    if str((globals or {}).get("__name__")).partition(".")[0] not in _OURS:
        return found
    if name in _GONE:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return _as_of_3_10(found.__name__) if found.__name__ in NEWER else found


def hide_newer() -> None:
    """From now on our modules see Python 3.10's library; none of them may be loaded yet."""
    assert not any(name.partition(".")[0] in _OURS for name in sys.modules)
    builtins.__import__ = _import_as_3_10
