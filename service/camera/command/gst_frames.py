#!/usr/bin/python3
"""A GStreamer pipeline's frames with the times at which they were taken, for camera.source.kind = "command".

    gst_frames.py [--clock monotonic|unix] PIPELINE...

It is run by the system's Python, which has GStreamer's bindings (Debian: python3-gi, gir1.2-gst-plugins-base-1.0), and
imports nothing of ours. PIPELINE is as for gst-launch-1.0, without a sink, and gives video/x-raw of the format that the
config says; each frame goes to standard output, its time as a line to descriptor 3. By "monotonic" that is the buffer's
own time on CLOCK_MONOTONIC: a sensor's, where the source stamps what it takes, as v4l2src and libcamerasrc do. By
"unix" it is the camera's own wall clock, by RTCP sender reports, for `rtspsrc add-reference-timestamp-meta=true`:
frames before the first report are left out. Old frames are dropped, never queued.
"""

from __future__ import annotations

import os
import statistics
import sys
from collections import deque

if __name__ == "__main__":  # who reads or imports it elsewhere needs no GStreamer
    import gi

    gi.require_version("Gst", "1.0")
    gi.require_version("GstApp", "1.0")
    from gi.repository import Gst, GstApp  # noqa: F401  # GstApp: the sink's methods

_TIMES_FD = 3
_NTP_BEFORE_UNIX_NS = 2_208_988_800_000_000_000  # from 1900 to 1970
_COMPARED = 15  # frames
_MOST_APART_NS = 10_000_000


def main(arguments: list[str]) -> int:
    """Run until the pipeline ends or fails: 0 or 1; 2 for wrong arguments."""
    clock = "monotonic"
    if arguments[:1] == ["--clock"]:
        clock, arguments = arguments[1], arguments[2:]
    if not arguments or clock not in ("monotonic", "unix"):
        print("usage: gst_frames.py [--clock monotonic|unix] PIPELINE...", file=sys.stderr)
        return 2
    Gst.init(None)
    pipeline = Gst.parse_launch(" ".join(arguments) + " ! appsink name=frames max-buffers=2 drop=true sync=false")
    pipeline.use_clock(_monotonic_clock())
    pipeline.set_state(Gst.State.PLAYING)
    try:
        return _run(pipeline, clock)
    except BrokenPipeError:
        return 1
    finally:
        pipeline.set_state(Gst.State.NULL)


def _monotonic_clock() -> Gst.Clock:
    clock = Gst.SystemClock.obtain()
    clock.set_property("clock-type", 1)  # GST_CLOCK_TYPE_MONOTONIC
    return clock


def _run(pipeline: Gst.Pipeline, clock: str) -> int:
    reports = _Reports()
    frames, bus = pipeline.get_by_name("frames"), pipeline.get_bus()
    while True:
        sample = frames.try_pull_sample(Gst.SECOND // 2)
        if sample is not None:
            time_ns = reports.unix_ns(sample) if clock == "unix" else _monotonic_ns(sample, pipeline)
            if time_ns is not None:
                _write(sample, time_ns)
            continue
        message = bus.pop_filtered(Gst.MessageType.ERROR | Gst.MessageType.EOS)
        if message is not None and message.type == Gst.MessageType.ERROR:
            error, _ = message.parse_error()
            print(f"{message.src.get_name()}: {error.message}", file=sys.stderr)
            return 1
        if message is not None or frames.is_eos():
            return 0


def _monotonic_ns(sample: Gst.Sample, pipeline: Gst.Pipeline) -> int | None:
    buffer = sample.get_buffer()
    if buffer.pts == Gst.CLOCK_TIME_NONE:
        return None
    running_ns = sample.get_segment().to_running_time(Gst.Format.TIME, buffer.pts)
    return None if running_ns == Gst.CLOCK_TIME_NONE else int(pipeline.get_base_time() + running_ns)


class _Reports:
    """Times by RTCP's sender reports, held against the buffers' own.

    Where packets are lost, one in thirty frames carries the time of the frame before it; its buffer's own time does not
    agree then. Such frames are left out.
    """

    def __init__(self) -> None:
        self._apart_ns: deque[int] = deque(maxlen=_COMPARED)

    def unix_ns(self, sample: Gst.Sample) -> int | None:
        buffer = sample.get_buffer()
        meta = buffer.get_reference_timestamp_meta(Gst.Caps.from_string("timestamp/x-ntp"))
        if meta is None or buffer.pts == Gst.CLOCK_TIME_NONE:
            return None
        unix_ns = int(meta.timestamp) - _NTP_BEFORE_UNIX_NS
        self._apart_ns.append(unix_ns - buffer.pts)
        is_usual = abs(self._apart_ns[-1] - statistics.median_low(self._apart_ns)) <= _MOST_APART_NS
        return unix_ns if is_usual else None


def _write(sample: Gst.Sample, time_ns: int) -> None:
    buffer = sample.get_buffer()
    ok, view = buffer.map(Gst.MapFlags.READ)
    if not ok:
        return
    try:
        os.write(_TIMES_FD, b"%d.%06d\n" % divmod(time_ns, 1_000_000))
        data = memoryview(view.data)
        while data:
            data = data[os.write(1, data) :]
    finally:
        buffer.unmap(view)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
