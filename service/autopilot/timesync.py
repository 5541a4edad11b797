"""The offset between the host's clock and the autopilot's time since boot, from TIMESYNC replies; for `autopilot`.

A median over the lowest-RTT samples of a window is right from the first reply on; half the path's asymmetry stays.
"""

import numpy as np

OUTSTANDING = 64
SAMPLES = 256
BUCKETS = 10
JUMP_NS = 500_000_000
JUMP_SAMPLES = 3
HOLD_NS = 30_000_000_000
SLACK_NS = 20_000_000
SETTLED_SAMPLES = 10
DOUBT_NS = 3_000_000_000  # without a reply
SLOW_WINDOW_NS = 40_000_000_000  # at 1 Hz: crystals 50 ppm apart move its middle by 1 ms
SLOW_SAMPLES = 40
SLOW_GAP_NS = 500_000_000
ENVELOPE_SPREAD_S = 0.05  # one way of a telemetry radio (round trip 107 ms measured): what the envelope lags by


class Timesync:
    """Offset estimator over a window of `window_ns`, by the median of the `best` samples of least round trip."""

    def __init__(self, window_ns: int = 10_000_000_000, best: int = 10) -> None:
        if window_ns <= 0 or best < 1:
            raise ValueError(f"window_ns and best must be above 0, got {window_ns}, {best}")
        self._window_ns = window_ns
        self._best = best
        self._samples_ns = np.zeros((3, SAMPLES), dtype=np.int64)  # rows: arrival, round trip, offset
        self._bucket_ns = np.zeros((2, BUCKETS), dtype=np.int64)  # rows: bucket's number, its least offset
        self._jumped = False
        self._now_ns = 0
        self.reset()

    def reset(self) -> None:
        """Forget everything: the autopilot restarted."""
        self._sent_ns: dict[int, int] = {}
        self._last_ts1 = 0
        self._count = 0
        self._jumps = 0
        self._offset_ns: int | None = None
        self._last_reply_ns = 0
        self._bucket_ns[0] = -1
        self.rtt_ns: int | None = None
        self.spread_ns: int | None = None

    @property
    def source(self) -> str:
        """Where the offset comes from: "timesync", "envelope" or "none"."""
        if self._offset_ns is not None:
            return "timesync"
        return "none" if self._envelope_ns() is None else "envelope"

    @property
    def degraded(self) -> bool:
        """Whether the offset is not from recent replies."""
        return self._offset_ns is None or self._now_ns - self._last_reply_ns > HOLD_NS

    def is_settled(self, now_ns: int) -> bool:
        """Whether requests may be rare: enough replies, the last one lately, and none that seems to tell of a jump."""
        return self._count >= SETTLED_SAMPLES and not self._jumps and now_ns - self._last_reply_ns <= DOUBT_NS

    @property
    def spread_s(self) -> float:
        """How wrong the offset may be: half the width of the samples that it is the median of, more while degraded."""
        return ENVELOPE_SPREAD_S if self.degraded or self.spread_ns is None else self.spread_ns * 0.5e-9

    def offset_ns(self) -> int | None:
        """Host's clock minus time since boot."""
        return self._offset_ns if self._offset_ns is not None else self._envelope_ns()

    def request(self, now_ns: int) -> int:
        """The `ts1` of a request that leaves now, unlike any other outstanding."""
        ts1 = max(now_ns, self._last_ts1 + 1, 1)
        self.request_sent(ts1, now_ns)
        return ts1

    def request_sent(self, ts1: int, now_ns: int) -> None:
        """A request that left at `now_ns`; of too many outstanding the oldest is forgotten."""
        self._now_ns = max(self._now_ns, now_ns)
        self._last_ts1 = ts1
        self._sent_ns[ts1] = now_ns
        if len(self._sent_ns) > OUTSTANDING:
            del self._sent_ns[next(iter(self._sent_ns))]

    def reply(self, ts1: int, tc1: int, now_ns: int) -> bool:
        """Take a reply; False if it answers no request of ours, carries no time, or came before it was asked for."""
        self._now_ns = max(self._now_ns, now_ns)
        if tc1 <= 0:
            return False
        sent_ns = self._sent_ns.pop(ts1, None)
        if sent_ns is None or now_ns < sent_ns:
            return False
        rtt_ns = now_ns - sent_ns
        offset_ns = sent_ns + rtt_ns // 2 - tc1
        self._last_reply_ns = now_ns
        # A midpoint is wrong by up to half its round trip: a late reply on a full link is no jump.
        if self._offset_ns is not None and abs(offset_ns - self._offset_ns) > JUMP_NS + rtt_ns // 2:
            self._jumps += 1
            if self._jumps < JUMP_SAMPLES:
                return True
            self._count, self._jumped = 0, True
        self._jumps = 0
        self._samples_ns[:, self._count % SAMPLES] = now_ns, rtt_ns, offset_ns
        self._count += 1
        self._estimate(now_ns)
        return True

    def take_jump(self) -> bool:
        """Whether the offset jumped since the last call: the autopilot's clock started anew."""
        jumped, self._jumped = self._jumped, False
        return jumped

    def observe_boot(self, boot_ns: int, now_ns: int) -> None:
        """A message stamped `boot_ns` arrived: bounds the offset from above, for autopilots that never reply."""
        self._now_ns = max(self._now_ns, now_ns)
        number = now_ns * BUCKETS // self._window_ns
        column = number % BUCKETS
        is_new = int(self._bucket_ns[0, column]) != number
        if is_new or now_ns - boot_ns < self._bucket_ns[1, column]:
            self._bucket_ns[:, column] = number, now_ns - boot_ns

    def _estimate(self, now_ns: int) -> None:
        arrival_ns, rtt_ns, offset_ns = self._samples_ns[:, : min(self._count, SAMPLES)]
        recent = np.flatnonzero(arrival_ns >= now_ns - self._window_ns)
        is_slow = 3 <= len(recent) < SLOW_SAMPLES and np.diff(np.sort(arrival_ns[recent])[-3:]).min() >= SLOW_GAP_NS
        if is_slow and self._window_ns < SLOW_WINDOW_NS:
            newest = np.argsort(arrival_ns, kind="stable")[-SLOW_SAMPLES:]
            recent = np.sort(newest[arrival_ns[newest] >= now_ns - SLOW_WINDOW_NS])
        chosen = recent[np.argsort(rtt_ns[recent], kind="stable")[: self._best]]
        # After a few samples the best ten would hold a full link's late replies too, wrong by half their round trip.
        chosen = chosen[rtt_ns[chosen] <= 3 * rtt_ns[chosen[0]] + SLACK_NS]
        base_ns = int(offset_ns[chosen[0]])  # keeps the median's float arithmetic exact
        differences = offset_ns[chosen] - base_ns
        self._offset_ns = base_ns + round(float(np.median(differences)))
        self.rtt_ns = int(rtt_ns[chosen[0]])
        self.spread_ns = int(differences.max() - differences.min())

    def _envelope_ns(self) -> int | None:
        numbers, least_ns = self._bucket_ns
        held = numbers >= 0
        if not held.any():
            return None
        recent = held & (numbers > numbers.max() - BUCKETS)
        return int(least_ns[recent].min())
