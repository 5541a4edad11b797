"""An RTSP server of GStreamer's, whose picture shows the time at which it was taken; run by the system's Python.

    rtsp_server.py PORT [KEY=VALUE ...]: width, height, fps, bframes, audio (0 or 1), user, password, gop

The time is CLOCK_MONOTONIC in milliseconds, as black and white blocks in the picture's upper rows: `drawn_clock.py`
reads 32 of its bits, the lowest first, and 8 of a checksum. Prints `ready` once it listens.
"""

import sys
import time
import zlib

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402

BITS = 40


class ClockFactory(GstRtspServer.RTSPMediaFactory):
    def __init__(self, options: dict[str, str]) -> None:
        super().__init__()
        self.width, self.height = int(options.get("width", 640)), int(options.get("height", 360))
        self.fps, self.options = int(options.get("fps", 10)), options
        self.set_shared(True)

    def do_create_element(self, url: object) -> Gst.Element:
        bframes, gop = int(self.options.get("bframes", 0)), int(self.options.get("gop", 10))
        tune = "" if bframes else "tune=zerolatency"
        video = (
            f"appsrc name=clock is-live=true do-timestamp=false format=time "
            f"caps=video/x-raw,format=I420,width={self.width},height={self.height},framerate={self.fps}/1 ! "
            f"x264enc {tune} speed-preset=ultrafast bitrate=2000 key-int-max={gop} bframes={bframes} b-adapt=false "
            "threads=1 ! video/x-h264,profile=main ! rtph264pay name=pay0 pt=96 config-interval=-1"
        )
        audio = (
            " appsrc name=sound is-live=true format=time caps=audio/x-alaw,rate=8000,channels=1 ! "
            "rtppcmapay name=pay1 pt=8"
        )
        return Gst.parse_launch(f"( {video}{audio if self.options.get('audio') == '1' else ''} )")

    def do_configure(self, media: GstRtspServer.RTSPMedia) -> None:
        source = media.get_element().get_by_name_recurse_up("clock")
        sound = media.get_element().get_by_name_recurse_up("sound")
        state = {"number": 0}

        def push() -> bool:
            clock, base = source.get_clock(), source.get_base_time()
            if clock is None:
                return True
            now_ms = time.monotonic_ns() // 1_000_000
            running = clock.get_time() - base
            buffer = Gst.Buffer.new_wrapped(picture(self.width, self.height, now_ms, state["number"]))
            buffer.pts = buffer.dts = max(running, 0)
            buffer.duration = Gst.SECOND // self.fps
            state["number"] += 1
            if sound is not None:
                silence = Gst.Buffer.new_wrapped(b"\xd5" * (8000 // self.fps))
                silence.pts, silence.duration = buffer.pts, buffer.duration
                sound.emit("push-buffer", silence)
            return source.emit("push-buffer", buffer) == Gst.FlowReturn.OK

        GLib.timeout_add(round(1000 / self.fps), push)


def picture(width: int, height: int, now_ms: int, number: int) -> bytes:
    """I420: blocks of the clock's bits above, a ramp that moves below."""
    block = width // BITS
    now_ms &= 0xFFFFFFFF
    now_ms |= (zlib.crc32(now_ms.to_bytes(4, "little")) & 0xFF) << 32
    bits = b"".join((b"\xeb" if now_ms >> bit & 1 else b"\x10") * block for bit in range(BITS))
    bits += b"\x80" * (width - len(bits))
    ramp = bytes((column + 3 * number) % 160 + 40 for column in range(width))
    rows = height // 8
    return bits * rows + ramp * (height - rows) + b"\x80" * (width * height // 2)


def main(port: str, options: dict[str, str]) -> None:
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(port)
    factory = ClockFactory(options)
    factory.connect("media-configure", lambda _, media: factory.do_configure(media))
    if "user" in options:
        auth = GstRtspServer.RTSPAuth()
        token = GstRtspServer.RTSPToken()
        token.set_string("media.factory.role", "viewer")
        auth.add_basic(GstRtspServer.RTSPAuth.make_basic(options["user"], options["password"]), token)
        server.set_auth(auth)
        permissions = GstRtspServer.RTSPPermissions()
        permissions.add_permission_for_role("viewer", "media.factory.access", True)
        permissions.add_permission_for_role("viewer", "media.factory.construct", True)
        factory.set_permissions(permissions)
    server.get_mount_points().add_factory("/clock", factory)
    server.attach(None)
    print("ready", server.get_bound_port(), flush=True)
    GLib.MainLoop().run()


if __name__ == "__main__":
    main(sys.argv[1], dict(one.split("=", 1) for one in sys.argv[2:]))
