"""The composition root: opens everything, runs the stages as tasks of one group, closes in order."""

import asyncio
import contextlib
import itertools
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from distloc.types import CameraPose, RejectReason
from service.autopilot.autopilot import POSE_IDS, Autopilot
from service.autopilot.poses import WAIT_NS
from service.camera.blind import BlindWatch
from service.camera.frozen import FreezeWatch
from service.camera.sources import FrameSource, NoSource, open_source
from service.common.latest import Latest
from service.common.messages import Frame, Geodetic, LocatedTarget, MavFrame, VehicleState
from service.config.sections import Config, check
from service.flight.health import PipelineHealth
from service.flight.systemd_notify import notify
from service.flight.watchdog import Watchdog
from service.localise.stage import Localised, LocaliseStage, Locator
from service.localise.track_keeper import open_keeper
from service.mavlink.framer import decode
from service.mavlink.link import Link
from service.mavlink.links import MavlinkLinks
from service.publish.footprint import footprint
from service.publish.mavlink import MavlinkPublisher
from service.publish.overlay import annotated, encoded_jpeg
from service.publish.wire import encode, report_from_target, report_from_vehicle
from service.publish.zenoh import NullPublisher, ZenohPublisher
from service.recordings.recorder import NullRecorder, Recorder
from service.segmenters.segment import make_segmenter

log = logging.getLogger(__name__)

_TICK_S = 0.025
_TICKS_A_SEND = 2  # 20 Hz: the shortest interval that a ground station may ask for
_VEHICLE_NS = 500_000_000
_STATUS_NS = 1_000_000_000
_COMMAND_IDS = frozenset({75, 76})  # COMMAND_INT, COMMAND_LONG
_SHUTDOWN_S = 5.0
_CAMERA_RETRY_S = 1.0
_SLACK_S = 0.001  # a timer may fire a little early
_READ_S = 0.5  # of a frame that comes

Observer = Callable[[Localised, list[LocatedTarget]], None]


class App:
    """The service. `run` returns once `stop` is set; `source` is for who brings a camera of their own."""

    def __init__(
        self,
        config: Config,
        config_text: str = "",
        source: FrameSource | None = None,
    ) -> None:
        check(config)
        self.config = config
        camera = config.camera.camera()
        unix_offset_ns = time.time_ns() - time.monotonic_ns()
        self.autopilot = Autopilot(
            config.mavlink,
            config.camera.mount,
            host_utc_offset_s=unix_offset_ns * 1e-9,
            pose_errors=config.pose_errors.pose_errors(),
        )
        segmenter = make_segmenter(config.segmenter, camera)
        self.keeper = open_keeper(config, self.autopilot)
        self.stage = LocaliseStage(config, segmenter, self.autopilot, keeper=self.keeper)
        self.mavlink = MavlinkPublisher(camera, config.mavlink.command_systems)
        self.zenoh = ZenohPublisher(config.zenoh, config.vehicle) if config.zenoh.enabled else NullPublisher()
        self.recorder: Recorder | NullRecorder = NullRecorder()
        if config.recorder.folder:
            self.recorder = Recorder(unix_offset_ns, config.recorder.frames)
        self.health = PipelineHealth(self)
        self._wires = MavlinkLinks(config.mavlink, self.recorder, self._on_message)
        self.links = self._wires.links
        self.watchdog = Watchdog(self.links)
        self.frames: Latest[Frame] = Latest()
        self.rejects: Counter[RejectReason] = Counter()
        self.freeze, self.blindness = FreezeWatch(), BlindWatch()
        self._config_text = config_text
        self._source: FrameSource = source or NoSource()
        self._is_brought = source is not None
        self.has_camera = self._is_brought or config.camera.source.kind != "none"
        self._observer: Observer = lambda localised, targets: None
        self._camera = camera
        self._locator = Locator(self.autopilot)
        self._stop = asyncio.Event()
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="localise")
        self._pose_came = asyncio.Event()
        self._vehicle: VehicleState | None = None
        self._vehicle_due_ns = self._status_due_ns = 0
        self._located: list[LocatedTarget] = []
        self._last_preview_ns = 0

    def observe(self, observer: Observer) -> None:
        """Have each localised frame and its reports handed over, on the event loop."""
        self._observer = observer

    async def run(self, stop: asyncio.Event) -> None:
        """Open, serve until `stop`, close. Raises LinkError, SourceError for what cannot be opened at all."""
        self._stop = stop
        async with contextlib.AsyncExitStack() as stack:
            if not self._is_brought:
                self._source = open_source(self.config.camera.source, self._camera, time.monotonic_ns, is_awaited=True)
            stack.callback(self._source.close)
            for link in self.links:
                await link.open()
                stack.callback(link.close)
            if self.config.recorder.folder:
                self.recorder.open(Path(self.config.recorder.folder), self._config_text)
            stack.callback(self.recorder.close)
            self.zenoh.open()
            stack.callback(self.zenoh.close)
            stack.callback(self.keeper.close)
            stack.callback(self._worker.shutdown, wait=True, cancel_futures=True)
            notify("READY=1")
            log.info("ready: %s", ", ".join(link.url for link in self.config.mavlink.links) or "no link")
            await self._serve()
            notify("STOPPING=1")

    async def _serve(self) -> None:
        loop = asyncio.get_running_loop()
        ended = threading.Event()
        camera = threading.Thread(target=self._capture, args=(self._source, loop, ended), name="camera", daemon=True)
        camera.start()
        async with asyncio.TaskGroup() as group:
            tasks = [group.create_task(link.run(), name=link.name) for link in self.links]
            tasks.append(group.create_task(self._tick(), name="tick"))
            tasks.append(group.create_task(self._localise(), name="localise"))
            await self._stop.wait()
            ended.set()
            for task in tasks:
                task.cancel()
        await asyncio.to_thread(camera.join, _READ_S)
        self._source.close()  # ends a read that waits for a lost camera: a thread inside OpenCV at exit aborts it
        await asyncio.to_thread(camera.join, _SHUTDOWN_S)

    def _capture(self, source: FrameSource, loop: asyncio.AbstractEventLoop, ended: threading.Event) -> None:
        has_failed = False
        while not ended.is_set():
            try:
                frame = source.read()
            except Exception:  # the service goes on without its camera; the status says "camera"
                if not has_failed:
                    log.exception("the camera failed")
                has_failed = True
                ended.wait(_CAMERA_RETRY_S)
                continue
            has_failed = False
            if frame is None:
                log.info("the camera's frames have ended")
                return
            with contextlib.suppress(RuntimeError):  # the loop closed between the two lines
                loop.call_soon_threadsafe(self._on_frame, frame)

    def _on_frame(self, frame: Frame) -> None:
        self.health.frame_heard(frame.stamp_ns)
        self.recorder.frame(frame.stamp_ns, frame.name, frame.image)
        if self.blindness.sees_nothing(frame):  # asked first: an overexposed camera gives the same white again
            self.rejects[RejectReason.BLIND_FRAME] += 1
            self.health.frame_unusable()
            return
        if self.freeze.is_repeated(frame):
            self.rejects[RejectReason.FROZEN_FRAME] += 1
            self.health.frame_unusable()
            return
        self.watchdog.frame_waits(time.monotonic_ns())
        self.frames.put(frame)

    def _on_message(self, link: Link, frame: MavFrame, now_ns: int) -> None:
        if self._wires.faces_autopilot(link):
            self.autopilot.receive(frame, now_ns)
            if frame.message_id in POSE_IDS:
                self._pose_came.set()
        if frame.message_id in _COMMAND_IDS:
            self.mavlink.see_vehicle(self.vehicle_state(now_ns))  # an answer tells of now, not of the last tick
            for reply in self.mavlink.handle(decode(frame), now_ns):
                self._wires.send(link, reply, now_ns)

    async def _localise(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            frame = await self.frames.get()
            self.watchdog.frame_waits(time.monotonic_ns())
            pose = await self._pose_of(frame)
            if isinstance(pose, RejectReason):
                self.rejects[pose] += 1
                self.watchdog.frame_refused()
                continue
            self.health.frame_given(time.monotonic_ns())
            try:
                localised = await loop.run_in_executor(self._worker, self.stage.process, frame, pose)
            except Exception:  # one frame is lost, not the service
                self.rejects[RejectReason.SEGMENTATION_FAILED] += 1
                self.watchdog.frame_failed(time.monotonic_ns())
                log.exception("frame %s was not localised", frame.name)
                continue
            if localised.reason is RejectReason.SEGMENTATION_FAILED:
                self.watchdog.frame_failed(time.monotonic_ns())
            else:
                self.watchdog.frame_done()
            if localised.mask is not None:
                self.health.mask_made()
            self._publish(localised)

    async def _pose_of(self, frame: Frame) -> CameraPose | RejectReason:
        while True:
            self._pose_came.clear()
            now_ns = time.monotonic_ns()
            pose = self.autopilot.camera_pose(frame.stamp_ns, now_ns)
            if pose is not None:
                return pose
            left_s = max(frame.stamp_ns + WAIT_NS - now_ns, 0) * 1e-9
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(left_s + _SLACK_S):
                    await self._pose_came.wait()

    def _publish(self, localised: Localised) -> None:
        now_ns = time.monotonic_ns()
        targets = self._locator.locate(localised.estimates, localised.frame.stamp_ns)
        for target in targets:
            report = report_from_target(target, self.config.vehicle)
            self.zenoh.publish_report(target.estimate.id, encode(report))
        if targets:
            self._located = targets
            for data in self.mavlink.update(targets, now_ns):
                self._wires.send_all(data, now_ns)
        if self.config.zenoh.preview and now_ns - self._last_preview_ns >= 1_000_000_000:
            self._last_preview_ns = now_ns
            picture = annotated(localised, self._camera)
            if picture is not None:
                self.zenoh.publish_preview(encoded_jpeg(picture))
        self._observer(localised, targets)

    async def _tick(self) -> None:
        for number in itertools.count():
            now_ns = time.monotonic_ns()
            for data in self.autopilot.due(now_ns):
                self._wires.send_autopilot(data, now_ns)
            if number % _TICKS_A_SEND == 0:
                self._send_due(now_ns)
            await asyncio.sleep(_TICK_S)

    def _send_due(self, now_ns: int) -> None:
        if self.autopilot.target_system:
            self.mavlink.set_system(self.autopilot.target_system)
        is_vehicle_due = now_ns >= self._vehicle_due_ns
        if is_vehicle_due or self.mavlink.needs_vehicle(now_ns):
            self._vehicle = self.vehicle_state(now_ns)
        degraded = self.health.degraded(now_ns)
        boot_ns = self.autopilot.boot_from_host(now_ns) or 0
        for data in self.mavlink.due(now_ns, boot_ns // 1_000_000 & 0xFFFFFFFF, degraded, self._vehicle):
            self._wires.send_all(data, now_ns)
        if self._wires.has_adsb:
            for data in self.mavlink.adsb(self._located, now_ns):
                self._wires.send_adsb(data, now_ns)
        if is_vehicle_due and self._vehicle is not None:
            self._vehicle_due_ns = now_ns + _VEHICLE_NS
            self.zenoh.publish_vehicle(encode(report_from_vehicle(self._vehicle, self.config.vehicle)))
        if now_ns >= self._status_due_ns:
            self._status_due_ns = now_ns + _STATUS_NS
            self.zenoh.publish_status(encode(self.health.report(now_ns)))
            self.watchdog.feed(now_ns, f"degraded: {', '.join(degraded)}" if degraded else "ok")

    def vehicle_state(self, now_ns: int) -> VehicleState | None:
        """The camera's pose 0.3 s ago, where it has surely settled, and what it sees of flat ground at home."""
        stamp_ns = now_ns - 300_000_000
        pose = self.autopilot.camera_pose(stamp_ns, now_ns)
        frame_enu = self.autopilot.frame_enu
        if not isinstance(pose, CameraPose) or frame_enu is None:
            return None
        time_utc_s, source = self.autopilot.utc_s(stamp_ns)
        place = Geodetic(*frame_enu.geodetic_from_enu(pose.position_enu_m))
        corners = footprint(pose, self._camera, frame_enu)
        return VehicleState(time_utc_s, source, place, self.autopilot.heading_deg or 0.0, pose, corners)

    def counters(self) -> dict[str, Any]:
        """What the status carries."""
        rejects: Counter[RejectReason] = Counter()
        for part in (self.rejects, self.stage.rejects, self._source.rejected):
            rejects.update(dict(part))  # copied at once: other threads count on
        return {
            "autopilot": self.autopilot.counters(),
            "links": self._wires.counters(),
            "commands": dict(self.mavlink.commands),
            "frames": {"localised": self.stage.frames, "dropped": self.frames.dropped},
            "rejects": {str(reason): count for reason, count in sorted(rejects.items())},
            "segmenter": self.stage.segmenter.name,
            "ground": self.stage.ground.counters(),
            "zenoh": self.zenoh.counters,
            "recorder": self.recorder.counters,
            "tracks": self.keeper.counters(),
        }
