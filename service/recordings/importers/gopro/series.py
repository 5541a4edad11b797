"""A stream over all payloads of a film, with the time of each sample on the film's clock. Free of I/O.

GPMF gives payloads a time and samples none: those of an even rate lie on a line through the payloads' starts; those
that carry a clock of their own came within their payload, which ties that clock.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from distloc.types import FloatArray
from service.recordings.importers.gopro.gpmf import Stream, streams_of
from service.recordings.importers.rows import MOST_SAMPLES

_LEAST_FOR_LINE = 3


@dataclass
class Series:
    """One stream: `values` (N, m); sample j of payload `payload[j]` (N,); `first` is the first payload's stream."""

    key: str
    device: str
    first: Stream
    starts_s: FloatArray
    parts: list[FloatArray] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    notes: list[tuple[int, Stream]] = field(default_factory=list)
    count: int = 0

    @property
    def values(self) -> FloatArray:
        """(N, m)."""
        return np.concatenate(self.parts)

    @property
    def payload(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """(N,): which payload each sample came in."""
        return np.repeat(np.array(self.numbers), [len(part) for part in self.parts])

    def even_times_s(self) -> FloatArray:
        """(N,) on the film's clock, of samples at an even rate."""
        before = np.concatenate([[0], np.cumsum([len(part) for part in self.parts])])
        starts_s = self.starts_s[np.array(self.numbers)]
        ends_s = self.starts_s[np.array(self.numbers) + 1]
        if len(self.parts) < _LEAST_FOR_LINE:
            shares = [np.arange(len(part)) / len(part) for part in self.parts]
            return np.concatenate([a + share * (b - a) for a, b, share in zip(starts_s, ends_s, shares, strict=True)])
        # full payloads only: the last may be cut
        step_s, first_s = np.polyfit(before[:-1].astype(np.float64), starts_s, 1)
        return np.asarray(first_s + step_s * np.arange(before[-1]))

    def clock_tie(self, stamps_s: FloatArray) -> tuple[float, float]:
        """What to add to stamps (N,) of the samples' own clock for the film's, and half of what is not known of it.

        A sample came after its stamp, within its payload. Half is infinite where one offset cannot fit them all.
        """
        good = np.isfinite(stamps_s)
        if not good.any():
            return 0.0, np.inf
        payload, stamps_s = self.payload[good], stamps_s[good]
        starts_s, ends_s = self.starts_s[payload], self.starts_s[payload + 1]
        least_s, most_s = float((starts_s - stamps_s).max()), float((ends_s - stamps_s).min())
        if least_s > most_s:
            return float(np.median((starts_s + ends_s) / 2.0 - stamps_s)), np.inf
        return (least_s + most_s) / 2.0, (most_s - least_s) / 2.0


def gathered(payloads: Iterable[bytes], starts_s: FloatArray, wanted: frozenset[str]) -> tuple[dict[str, Series], int]:
    """The wanted streams by key, each of the device that has it first, and the payloads that told nothing.

    `starts_s` (n + 1,) is when each payload begins, and the end. Of a stream no more than `MOST_SAMPLES` are held.
    """
    found: dict[str, Series] = {}
    silent = 0
    for number, payload in enumerate(payloads):
        streams = streams_of(payload)
        silent += not streams
        for stream in streams:
            if stream.key in wanted:
                _add(found, number, stream, starts_s)
    return found, silent


def _add(found: dict[str, Series], number: int, stream: Stream, starts_s: FloatArray) -> None:
    one = found.get(stream.key)
    if one is None:
        one = found[stream.key] = Series(stream.key, stream.device, stream, starts_s)
    is_alike = stream.device_id == one.first.device_id and stream.values.shape[1] == one.first.values.shape[1]
    if not is_alike or one.count + len(stream.values) > MOST_SAMPLES:
        return
    if one.numbers and one.numbers[-1] == number:
        one.parts[-1] = np.concatenate([one.parts[-1], stream.values])
    else:
        one.parts.append(stream.values)
        one.numbers.append(number)
        one.notes.append((number, stream))
    one.count += len(stream.values)
