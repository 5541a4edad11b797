"""An ONNX model opened in ONNX Runtime: its ports, its metadata, the provider really got; runs one input at a time.

A model computes and nothing else: no library of custom operators is ever registered, and weights beside the file are
read from its own folder only (ONNX Runtime refuses other places).
"""

import hashlib
import logging
import math
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.config.sections import ConfigError
from service.segmenters.model_file import other_kind

_DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
CPU, TENSORRT = "CPUExecutionProvider", "TensorrtExecutionProvider"
GIVES_BACK = "MALLOC_MMAP_THRESHOLD_"  # glibc's, see mallopt(3); read at exec, so it cannot be set from here
RUN_LIMIT_S = 60.0  # the watchdog has a service that waits so long for a frame started anew
BUILD_LIMIT_S = 1200.0  # of the first run on a GPU, in which an engine may be built
MOST_NUMBERS = 200_000_000  # in one input or output: 800 MB
_log = logging.getLogger(__name__)


class ModelError(Exception):
    """The model cannot be run on an input, or gives what its card does not say."""


@dataclass(frozen=True, slots=True)
class Port:
    """An input or an output; a side that is no positive number is free."""

    name: str
    kind: str  # "float", "float16", ...
    shape: tuple[int | str | None, ...]

    def takes(self, shape: Sequence[int]) -> bool:
        """Whether an array of this shape fits."""
        return len(self.shape) == len(shape) and all(
            not is_fixed(own) or own == side for own, side in zip(self.shape, shape, strict=True)
        )

    def __str__(self) -> str:
        sides = " x ".join(str(side) if is_fixed(side) else f"{side or '?'} (free)" for side in self.shape)
        return f"{self.name}  {self.kind}  {sides}"


def is_fixed(side: int | str | None) -> bool:
    """Whether a side of a port has a length of its own."""
    return isinstance(side, int) and side > 0


@dataclass(frozen=True, slots=True)
class Tuning:
    """How a session is opened: the providers' options by their names, lengths of free sides by theirs, and where a
    profile of what it runs is written (the beginning of a file's path; empty: none is made)."""

    options: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    sides: Mapping[str, int] = field(default_factory=dict)
    profile: str = ""


class ModelSession:
    """Raises ConfigError, naming the file, for what is no model of one input; ModelError where it cannot be run.

    With `sha256`, the very bytes that were checked are run; weights beside the file are then refused.
    """

    def __init__(
        self, path: Path, providers: Sequence[str], sha256: str = "", tuning: Tuning | None = None, is_told: bool = True
    ) -> None:
        self.path = path
        self._session = _opened(path, providers, sha256, tuning or Tuning())
        self.inputs = tuple(_port(one) for one in self._session.get_inputs())
        self.outputs = tuple(_port(one) for one in self._session.get_outputs())
        self.metadata: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        self.provider: str = self._session.get_providers()[0]
        dtype = _DTYPES.get(f"tensor({self.inputs[0].kind})") if len(self.inputs) == 1 else None
        if dtype is None:
            ports = "; ".join(map(str, self.inputs))
            raise ConfigError(
                f"segmenter.model is {str(path)!r}: it needs one input of numbers, float, float16 or uint8, has {ports}"
            )
        for port in (*self.inputs, *self.outputs):
            if math.prod(side for side in port.shape if isinstance(side, int) and side > 0) > MOST_NUMBERS:
                raise ConfigError(f"segmenter.model is {str(path)!r}: {port} has more than {MOST_NUMBERS} numbers")
        self._dtype = dtype
        self._limit_s = RUN_LIMIT_S if self.provider == CPU else BUILD_LIMIT_S
        if is_told:
            _log_provider(self.provider, providers)

    @property
    def takes_uint8(self) -> bool:
        """Whether its input holds whole numbers from 0 to 255 only."""
        return self._dtype is np.uint8

    def run(self, values: NDArray[np.float32], output_name: str) -> NDArray[np.float32]:
        """The output of that name for one input; see `outputs_of`."""
        return self.outputs_of(values, (output_name,))[0]

    def outputs_of(self, values: NDArray[np.float32], names: Sequence[str]) -> list[NDArray[np.float32]]:
        """The outputs of these names for one input; what they hold is not checked.

        A run ends RUN_LIMIT_S after its begin, at the model's next node: what one node computes or holds has no bound.
        """
        limit_s, self._limit_s = self._limit_s, RUN_LIMIT_S
        options = runtime().RunOptions()
        timer = threading.Timer(limit_s, setattr, (options, "terminate", True))
        timer.daemon = True
        timer.start()
        try:
            given = {self.inputs[0].name: values.astype(self._dtype, copy=False)}
            return [np.asarray(one, dtype=np.float32) for one in self._session.run(list(names), given, options)]
        except Exception as error:  # ONNX Runtime's errors have no common base below Exception
            why = f"it ran for over {limit_s:g} s" if options.terminate else _first_line(error)
            raise ModelError(f"the model failed: {why}") from error
        finally:
            timer.cancel()

    def end_profile(self) -> Path:
        """The file with the profile of what was run so far; nothing is added to it any more."""
        return Path(self._session.end_profiling())


def runtime() -> Any:
    """ONNX Runtime, loaded with the first model; ConfigError where this computer has none that works."""
    try:
        import onnxruntime
    except ImportError as error:
        raise ConfigError(
            f"segmenter.kind is 'onnx': ONNX Runtime cannot be loaded ({_first_line(error)}): install onnxruntime, or "
            "take segmenter.kind = 'classical', which finds far less"
        ) from error
    return onnxruntime


def open_on_cpu(path: Path, providers: Sequence[str], sha256: str = "") -> ModelSession:
    """For a service that goes over to the first of the providers that there are, if any; errors as ModelSession's."""
    goes_over = bool(accelerators(providers))
    return ModelSession(path, (CPU,) if goes_over else providers, sha256, is_told=not goes_over)


def _opened(path: Path, providers: Sequence[str], sha256: str, tuning: Tuning) -> Any:
    if not path.is_file():
        raise ConfigError(
            f"segmenter.model is {str(path)!r}: no such file; name one that is there, or leave it out for ours"
        )
    if kind := other_kind(path):
        raise ConfigError(
            f"segmenter.model is {str(path)!r}: {kind}; only ONNX is run: export the model anew, with ONNX as format"
        )
    options = runtime().SessionOptions()
    options.intra_op_num_threads = 2
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")  # spinning costs half as much CPU again
    # The arena keeps twice what a run needs; without it glibc would keep more still, unless it is told (as the systemd
    # unit does) to give large blocks back at once. Then the service holds 40 MB less, and a run takes a tenth longer.
    options.enable_cpu_mem_arena = GIVES_BACK not in os.environ
    options.log_severity_level = 3
    for side, length in tuning.sides.items():
        options.add_free_dimension_override_by_name(side, length)
    if tuning.profile:
        options.enable_profiling, options.profile_file_prefix = True, tuning.profile
    asked = [(name, dict(tuning.options.get(name, {}))) for name in usable(providers)]
    model = _checked(path, sha256) if sha256 else str(path)
    if sha256:
        options.add_session_config_entry("session.model_external_initializers_file_folder_path", os.devnull)
    try:
        session = runtime().InferenceSession(model, options, providers=asked, enable_fallback=0)
        session.disable_fallback()  # what failed on a GPU is ours to tell, and to run elsewhere
        return session
    except Exception as error:  # as above
        raise ConfigError(
            f"segmenter.model is {str(path)!r}: not a model that can be run: {_first_line(error)}"
        ) from error


def _checked(path: Path, sha256: str) -> bytes:
    try:
        held = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"segmenter.model is {str(path)!r}: cannot be read: {error.strerror}") from error
    found = hashlib.sha256(held).hexdigest()
    if found != sha256.lower():
        raise ConfigError(f"segmenter.sha256 is {sha256.lower()}: {str(path)!r} has {found}; not the model meant")
    return held


def usable(providers: Sequence[str]) -> list[str]:
    """Those of them that the installed ONNX Runtime has, in their order; the CPU where it has none."""
    available = runtime().get_available_providers()
    return [name for name in providers if name in available] or [CPU]


def accelerators(providers: Sequence[str]) -> list[str]:
    """Those that are wanted rather than the CPU and that the installed ONNX Runtime has."""
    wanted = usable(providers)
    return wanted[: wanted.index(CPU)] if CPU in wanted else wanted


def _log_provider(got: str, providers: Sequence[str]) -> None:
    first = usable(providers)[0]
    if got != first or first not in providers:
        _log.warning("the segmenter runs on %s, as %s cannot be had", got, ", ".join(providers) or "none")


def _port(port: Any) -> Port:
    return Port(str(port.name), str(port.type).removeprefix("tensor(").removesuffix(")"), tuple(port.shape))


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
