"""Which provider each part of a model really got, from ONNX Runtime's profile of a run."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import msgspec

from service.segmenters.accelerator.protocol import Part

_MOST_KINDS = 5
_KERNEL = "_kernel_time"


def parts_of_profile(path: Path) -> tuple[Part, ...]:
    """The providers in a profile, that with most of the time first; none where it cannot be read."""
    try:
        events = msgspec.json.decode(path.read_bytes(), type=list[dict[str, Any]])
    except (OSError, msgspec.DecodeError, msgspec.ValidationError):
        return ()
    return parts_of_events(events)


def parts_of_events(events: Sequence[dict[str, Any]]) -> tuple[Part, ...]:
    """Of the kernels in the order in which they ran; copies between a GPU and the CPU are no nodes of the model."""
    ran = [
        (str(one["args"].get("provider") or ""), str(one["args"].get("op_name", "")), float(one.get("dur", 0)))
        for one in events
        if one.get("cat") == "Node" and str(one.get("name", "")).endswith(_KERNEL) and one.get("args")
    ]
    nodes = [node for node in ran if node[0] and not node[1].startswith("Memcpy")]
    total_us = sum(took_us for _, _, took_us in nodes) or 1.0
    pieces = Counter(provider for provider, _ in groupby(provider for provider, _, _ in nodes))
    kinds: dict[str, Counter[str]] = defaultdict(Counter)
    times_us: Counter[str] = Counter()
    for provider, kind, took_us in nodes:
        kinds[provider][kind] += 1
        times_us[provider] += took_us  # type: ignore[assignment]
    found = [
        Part(
            provider,
            kinds[provider].total(),
            pieces[provider],
            times_us[provider] / total_us,
            tuple(kind for kind, _ in kinds[provider].most_common(_MOST_KINDS)),
        )
        for provider in kinds
    ]
    return tuple(sorted(found, key=lambda part: -part.share))


def parts_text(parts: Sequence[Part]) -> str:
    """All of the model in words: `Tensorrt 1 node (97 % of the time), CPU 3 nodes in 2 pieces (3 %: Resize, Cast)`."""
    return ", ".join(_text(part, is_first=place == 0) for place, part in enumerate(parts))


def short(provider: str) -> str:
    """`CPU` for CPUExecutionProvider."""
    return provider.removesuffix("ExecutionProvider")


def _text(part: Part, is_first: bool) -> str:
    nodes = f"{part.nodes} node{'s' * (part.nodes != 1)}"
    pieces = f" in {part.pieces} pieces" if part.pieces > 1 else ""
    kinds = "" if is_first else f": {', '.join(part.kinds)}"
    return f"{short(part.provider)} {nodes}{pieces} ({part.share:.0%}{' of the time' * is_first}{kinds})"
