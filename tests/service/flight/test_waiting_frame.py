"""A frame that came before its pose, in the real service: localised as soon as the pose is there, else refused."""

import asyncio
import queue
import time
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from distloc.types import CameraPose, RejectReason
from service.autopilot.poses import ATTITUDE_AHEAD_NS, WAIT_NS
from service.camera.sources import NoSource
from service.common.messages import Frame
from service.config.sections import CameraConfig, Config, LinkConfig, MavlinkConfig, ZenohConfig
from service.flight import frame_loop
from service.flight.app import App
from tests.support.running_app import HANG_S, Sender, run, until

CAMERA = CameraConfig(width=64, height=48, fx=50.0, fy=50.0, cx=32.0, cy=24.0)
SCENE = np.tile(np.arange(0, 192, 3, dtype=np.uint8)[:, None], (48, 1, 3))


class Shutter(NoSource):
    """A camera that gives a frame when it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self._frames: queue.Queue[Frame | None] = queue.Queue()
        self._shade = 0

    def release(self, stamp_ns: int) -> None:
        self._shade += 1  # a picture that repeats would count as frozen
        self._frames.put(Frame(stamp_ns, str(stamp_ns), SCENE + np.uint8(self._shade)))

    def read(self) -> Frame | None:
        return self._frames.get()

    def close(self) -> None:
        self._frames.put(None)


class Flight:
    """The service, its camera, and an autopilot that flies when it is told to; `asked` counts by the frame's stamp."""

    def __init__(self, app: App, shutter: Shutter, sender: Sender) -> None:
        self.app, self.shutter = app, shutter
        self.localised: list[int] = []
        self.asked: Counter[int] = Counter()
        self._sender = sender
        for track in (app.autopilot.poses.attitudes, app.autopilot.poses.positions):
            track.gap_ns = round(HANG_S * 1e9)  # a busy machine may sleep between two samples
        self._booted_ns = time.monotonic_ns() - 10_000_000_000
        app.observe(lambda localised, targets: self.localised.append(localised.frame.stamp_ns))
        self._camera_pose = app.autopilot.camera_pose
        app.autopilot.camera_pose = self._counted  # type: ignore[method-assign]

    def _counted(self, stamp_ns: int, now_ns: int) -> CameraPose | RejectReason | None:
        self.asked[stamp_ns] += 1
        return self._camera_pose(stamp_ns, now_ns)

    def fly(self) -> None:
        """One attitude and one position of now."""
        boot_ms = (time.monotonic_ns() - self._booted_ns) // 1_000_000
        place = (400_000_000, 30_000_000, 100_000, 50_000)
        for message in (
            mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_global_position_int_message(boot_ms, *place, 0, 0, 0, 0),
        ):
            self._sender.send(self._sender.pack(message))

    async def start(self) -> None:
        self._sender.heartbeat()
        self._sender.send(self._sender.pack(mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 9)))
        end_s = time.monotonic() + HANG_S
        while self.app.autopilot.poses.position_count < 3:
            assert time.monotonic() < end_s, "no positions were taken"
            self.fly()
            await asyncio.sleep(0.02)

    async def expose(self, ahead_ns: int = 2_000_000) -> int:
        """A frame so much later than now; its stamp, once that is past and its pose was asked for in vain."""
        stamp_ns = time.monotonic_ns() + ahead_ns
        self.shutter.release(stamp_ns)
        await until(lambda: self.asked[stamp_ns], "the frame is taken up")
        await until(lambda: time.monotonic_ns() > stamp_ns + 2_000_000, "its time is past")
        return stamp_ns


@asynccontextmanager
async def flying() -> AsyncIterator[Flight]:
    links = (LinkConfig(url="udpin:127.0.0.1:0"),)
    shutter = Shutter()
    config = Config(camera=CAMERA, mavlink=MavlinkConfig(links=links), zenoh=ZenohConfig(enabled=False))
    app, stop = App(config, source=shutter), asyncio.Event()
    serving = asyncio.create_task(app.run(stop))
    await until(lambda: app.links[0].state == "open" or serving.done(), "the link")
    try:
        with Sender(app) as sender:
            flight = Flight(app, shutter, sender)
            await flight.start()
            yield flight
    finally:
        stop.set()
        await serving


def test_it_is_localised_as_soon_as_its_pose_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_loop, "WAIT_NS", round(10 * HANG_S * 1e9))  # no timer can be what ends the wait

    async def body() -> None:
        async with flying() as flight:
            stamp_ns = await flight.expose()
            heard = flight.app.autopilot.messages["ATTITUDE"]
            assert flight.localised == [] and flight.asked[stamp_ns] <= 3
            flight.fly()
            await until(lambda: flight.localised, "the frame is localised")
            assert flight.localised == [stamp_ns] and not flight.app.rejects
            assert flight.app.autopilot.messages["ATTITUDE"] == heard + 1

    run(body())


def test_it_is_refused_once_no_pose_came_in_time() -> None:
    async def body() -> None:
        async with flying() as flight:
            stamp_ns = await flight.expose(2 * ATTITUDE_AHEAD_NS)
            await until(lambda: flight.app.rejects, "the frame is refused")
            assert time.monotonic_ns() - stamp_ns >= WAIT_NS
            assert flight.app.rejects == {RejectReason.STALE_POSE: 1} and flight.localised == []
            assert flight.asked[stamp_ns] <= 4  # nobody asks again and again for what cannot have come
            while not flight.localised:  # on a busy machine a frame may be too old before it is looked at
                refused = flight.app.rejects.total()
                stamp_ns = await flight.expose()
                flight.fly()
                await until(lambda had=refused: flight.localised or flight.app.rejects.total() > had, "it is used")
            assert flight.localised == [stamp_ns]

    run(body())
