"""Films in MPEG-TS with ST 0601 metadata, made by OpenCV's MPEG-2 encoder and stanag4609's muxer and encoder."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from stanag4609 import st0601
from stanag4609.transport import (
    PESStreamEvent,
    ProgramClockReference,
    TransportDemuxer,
    TransportMuxer,
    asynchronous_klv_stream,
    synchronous_klv_stream,
)

KLV_PID = 0x200
Carriage = Literal["sync", "async"]
Items = Mapping[int, Any]


def klv(items: Items) -> bytes:
    """A packet by an encoder that is not ours; item 65 is added."""
    return st0601.encode_uas_local_set({65: 19, **items})


def write_film(
    path: Path,
    pictures: list[NDArray[np.uint8]],
    packet_of: Callable[[float], bytes | None],
    carriage: Carriage = "sync",
    fps: float = 25.0,
    shift_pts: int = 0,
    codec: str = "MPG2",
) -> list[float]:
    """Write the film with `packet_of(s)` beside each picture, `s` seconds after the first; their times of being shown.

    The encoder makes pictures of both directions, which lie in the stream in another order than they are shown; what is
    not bound to them lies there by its time.
    """
    bare = path.with_suffix(".bare.ts")
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(bare), cv2.VideoWriter_fourcc(*codec), fps, (width, height))
    for picture in pictures:
        writer.write(picture)
    writer.release()
    demuxer = TransportDemuxer()
    events = [one for one in (*demuxer.feed(bare.read_bytes()), *demuxer.finish()) if isinstance(one, PESStreamEvent)]
    bare.unlink()
    video = events[0].stream
    klv_stream = (
        synchronous_klv_stream(KLV_PID, metadata_input_leak_rate=1000, metadata_buffer_size=64)
        if carriage == "sync"
        else asynchronous_klv_stream(KLV_PID)
    )
    muxer = TransportMuxer(
        transport_stream_id=1,
        program_number=1,
        program_map_pid=0x1000,
        pcr_pid=video.elementary_pid,
        streams=(video, klv_stream),
    )
    out: list[bytes] = [*muxer.program_tables()]
    first = min(event.pes.pts for event in events if event.pes.pts is not None)
    shown: list[float] = []
    for event in events:
        assert event.pes.pts is not None
        pts = (event.pes.pts + shift_pts) % 2**33
        shown.append((event.pes.pts - first) / 90_000)
        clock = (pts - 9000) % 2**33
        out.append(muxer.mux_pcr(ProgramClockReference(clock, 0)))
        out += muxer.mux_pes(video.elementary_pid, _with_pts(bytes(event.pes), shift_pts))
        number = len(shown) - 1
        packet = packet_of(shown[-1] if carriage == "sync" else number / fps)
        if packet is None:
            continue
        out += (
            muxer.mux_sync_klv(KLV_PID, packet, pts=pts) if carriage == "sync" else muxer.mux_async_klv(KLV_PID, packet)
        )
    path.write_bytes(b"".join(out))
    return sorted(shown)


def _with_pts(pes: bytes, shift: int) -> bytes:
    """The same with all its time stamps moved."""
    if not shift:
        return pes
    raw = bytearray(pes)
    for at in (9, 14)[: 1 + (pes[7] >> 6 & 1)]:
        a, b, c, d, e = raw[at : at + 5]
        value = ((a >> 1 & 7) << 30 | b << 22 | (c >> 1) << 15 | d << 7 | e >> 1) + shift
        value %= 2**33
        raw[at : at + 5] = bytes(
            (
                (a & 0xF0) | (value >> 30 & 7) << 1 | 1,
                value >> 22 & 0xFF,
                (value >> 15 & 0x7F) << 1 | 1,
                value >> 7 & 0xFF,
                (value & 0x7F) << 1 | 1,
            )
        )
    return bytes(raw)
