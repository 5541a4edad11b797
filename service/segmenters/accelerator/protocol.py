"""What the service and the process that has the GPU say to each other: JSON, outputs as bytes, inputs in memory."""

import math
import mmap
from collections.abc import Sequence
from multiprocessing.connection import Connection

import msgspec
import numpy as np
from numpy.typing import NDArray

MOST_WORDS = 1_000_000  # bytes of one message that is no array
MOST_ARRAY_BYTES = 800_000_000  # as ModelSession's MOST_NUMBERS


class Plan(msgspec.Struct, frozen=True, tag=True):
    """What is opened and how. `shapes` are the inputs that there will be, `sides` fixes free ones of them by name."""

    model: str
    sha256: str
    providers: tuple[str, ...]  # the best first, the CPU last
    input_name: str
    outputs: tuple[str, ...]
    shapes: tuple[tuple[int, ...], ...]
    sides: dict[str, int] = {}
    fp16: bool = False
    engines: str = ""  # the folder that keeps TensorRT's engines; empty: none are kept


class Part(msgspec.Struct, frozen=True):
    """What one provider runs of the model: nodes, in so many pieces, and its share of the time of a run."""

    provider: str
    nodes: int
    pieces: int
    share: float
    kinds: tuple[str, ...] = ()  # of its nodes, the commonest first


class Ready(msgspec.Struct, frozen=True, tag=True):
    """The session is open and has run. `notes` are of the engines kept."""

    provider: str
    parts: tuple[Part, ...] = ()
    notes: tuple[str, ...] = ()
    took_s: float = 0.0
    run_ms: float = 0.0


class Failed(msgspec.Struct, frozen=True, tag=True):
    """It cannot be opened, or a run failed."""

    why: str


class Gave(msgspec.Struct, frozen=True, tag=True):
    """A run's outputs follow, of these shapes, each as the bytes of a float32 array."""

    shapes: tuple[tuple[int, ...], ...]


class Given(msgspec.Struct, frozen=True, tag=True):
    """An input of this shape lies in the shared memory, as a float32 array: megabytes that no pipe has to carry."""

    shape: tuple[int, ...]


Word = Plan | Ready | Failed | Gave | Given


def input_bytes(plan: Plan) -> int:
    """Of the largest input that there will be."""
    return max(4 * math.prod(shape) for shape in plan.shapes)


def input_in(memory: mmap.mmap, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """The shared memory as an input of that shape; ValueError where it is too small."""
    return np.frombuffer(memory, np.float32, math.prod(shape)).reshape(shape)


def send(connection: Connection, word: Word, arrays: Sequence[NDArray[np.float32]] = ()) -> None:
    """A message and the arrays that it names."""
    connection.send_bytes(msgspec.json.encode(word))
    for array in arrays:
        connection.send_bytes(np.ascontiguousarray(array, dtype=np.float32).reshape(-1).view(np.uint8).data)


def receive(connection: Connection) -> Word:
    """The next message; EOFError or OSError at the other's end, msgspec's errors for what is none."""
    word: Word = msgspec.json.decode(connection.recv_bytes(MOST_WORDS), type=Word)
    return word


def receive_array(connection: Connection, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """The next array, one's own to write to; ValueError where its bytes are not of that shape."""
    data = bytearray(connection.recv_bytes(MOST_ARRAY_BYTES))
    if len(data) != 4 * math.prod(shape):
        raise ValueError(f"an array of shape {shape} has {4 * math.prod(shape)} bytes, got {len(data)}")
    return np.frombuffer(data, np.float32).reshape(shape)
