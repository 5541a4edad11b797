"""Makes the parts of a flight, opens them, runs them as tasks of one group and closes them in order."""

import asyncio
import contextlib
import itertools
import logging
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from distloc.types import RejectReason
from service.autopilot.autopilot import Autopilot
from service.autopilot.message_ids import POSE_IDS
from service.camera.sources import FrameSource, NoSource, open_source
from service.common import aio
from service.common.degraded import Degraded
from service.common.messages import LocatedTarget, MavFrame
from service.common.redact import redacted
from service.config.doubts import survey_without_calibration, told_errors
from service.config.landmarks import template_bytes
from service.config.load import check
from service.config.sections import Config
from service.flight.capture import Capture
from service.flight.follower import make_follower
from service.flight.frame_loop import FrameLoop
from service.flight.health import DegradedLog, FrameAges, degraded_names
from service.flight.host_watch import make_host_watch
from service.flight.outgoing import Outgoing
from service.flight.systemd_notify import notify
from service.flight.watchdog import Watchdog
from service.localise.adviser import AdviceWorker, Adviser
from service.localise.pipeline import FrameGate, FramePipeline
from service.localise.scenery import SceneryState, make_scenery
from service.localise.stage import Localised
from service.localise.track_keeper import open_keeper
from service.mavlink.link import Link
from service.mavlink.links import MavlinkLinks
from service.publish.exchange.tak.switch import make_tak
from service.publish.explained import report_from_explanation
from service.publish.wire import StatusReport, report_from_scenery, utc_text
from service.publish.zenoh import NullPublisher, ZenohPublisher
from service.recordings.recorder import NullRecorder, Recorder
from service.segmenters.segment import make_accelerator, make_segmenter

log = logging.getLogger(__name__)

_TICK_S = 0.025
_TICKS_A_SEND = 2  # 20 Hz: the shortest interval that a ground station may ask for
_COMMAND_IDS = frozenset({75, 76})  # COMMAND_INT, COMMAND_LONG

Observer = Callable[[Localised, list[LocatedTarget]], None]


class App:
    """The service. `run` returns once `stop` is set; `source` is for who brings a camera of their own."""

    def __init__(self, config: Config, config_text: str = "", source: FrameSource | None = None) -> None:
        check(config)
        self.config = config
        unix_offset_ns = time.time_ns() - time.monotonic_ns()
        self.autopilot = Autopilot(
            config.mavlink,
            config.camera.mount,
            host_utc_offset_s=unix_offset_ns * 1e-9,
            pose_errors=told_errors(config),
            camera=config.camera,
        )
        camera = config.camera.camera()
        self.accelerator = make_accelerator(config.segmenter)
        segmenter = make_segmenter(config.segmenter, camera, accelerator=self.accelerator)
        gate = FrameGate(config, self.autopilot)
        self.keeper, self.follower = (
            open_keeper(config, self.autopilot),
            make_follower(make_scenery(config, camera, lambda: self.autopilot.frame_enu)),
        )
        self._advice_worker = AdviceWorker()
        adviser = Adviser(config, self._advice_worker)
        self.pipeline = FramePipeline(
            config, segmenter, gate, keeper=self.keeper, scenery=self.follower, adviser=adviser
        )
        self.zenoh = ZenohPublisher(config.zenoh, config.vehicle) if config.zenoh.enabled else NullPublisher()
        self.tak = make_tak(config.tak, self._utc_s, config.localizer.max_targets)
        self.recorder: Recorder | NullRecorder = NullRecorder()
        if config.recorder.folder:
            settings = config.recorder
            self.recorder = Recorder(unix_offset_ns, settings.frames, settings.keep_flights, settings.least_free_gb)
        self._wires = MavlinkLinks(config.mavlink, self.recorder, self._on_message)
        self.links = self._wires.links
        self.outgoing = Outgoing(config, self.autopilot, self._wires, self.zenoh, self.tak)
        self.watchdog, self.host = Watchdog(self.links), make_host_watch(config)
        self._ages, self._degraded_log = FrameAges(), DegradedLog()
        self._flow = FrameLoop(self.pipeline, self.follower, self.recorder, self._ages, self.watchdog, self._publish)
        self.frames = self._flow.frames
        self._config_text = redacted(config_text)  # it is recorded
        self._source: FrameSource = source or NoSource()
        self._is_brought = source is not None
        self._has_camera = self._is_brought or config.camera.source.kind != "none"
        self._observer: Observer = lambda localised, targets: None

    def observe(self, observer: Observer) -> None:
        """Have each localised frame and its reports handed over, on the event loop."""
        self._observer = observer

    async def run(self, stop: asyncio.Event) -> None:
        """Open, serve until `stop`, close. Raises LinkError, SourceError for what cannot be used at all."""
        async with contextlib.AsyncExitStack() as stack:
            if not self._is_brought:
                camera = self.config.camera
                self._source = open_source(
                    camera.source, camera.camera(), time.monotonic_ns, is_awaited=True, is_paced=True
                )
            stack.callback(self._source.close)
            for link in self.links:
                await link.open()
                stack.callback(link.close)
            if self.config.recorder.folder:
                templates = template_bytes(self.config.landmarks)
                self.recorder.open(Path(self.config.recorder.folder), self._config_text, templates)
            stack.callback(self.recorder.close)
            self.outgoing.klv.open()
            stack.callback(self.outgoing.klv.close)
            self.zenoh.open()
            stack.callback(self.zenoh.close)
            self.tak.open()
            stack.callback(self.tak.close)
            stack.callback(self.keeper.close)
            self.host.start()
            stack.callback(self.host.close)
            stack.callback(self._advice_worker.close)
            stack.callback(self._flow.close)
            self.accelerator.start()
            stack.callback(self.accelerator.close)  # first: a run that hangs there would hold up the flow's end
            if doubt := survey_without_calibration(self.config):
                log.warning("%s", doubt)
            notify("READY=1")
            links = ", ".join(link.url for link in self.config.mavlink.links) or "no link"
            log.info("ready: %s; segmenter %s", links, self.pipeline.stage.segmenter.name)
            await self._serve(stop)
            notify("STOPPING=1")

    async def _serve(self, stop: asyncio.Event) -> None:
        capture = Capture(self._source, self._flow.take, stop.set, self.keeper.is_resuming)
        capture.start()
        async with aio.TaskGroup() as group:
            tasks = [group.create_task(link.run(), name=link.name) for link in self.links]
            tasks.append(group.create_task(self._tick(), name="tick"))
            tasks.append(group.create_task(self._flow.run(), name="localise"))
            await stop.wait()
            capture.stop()
            for task in tasks:
                task.cancel()
        await capture.close()
        if capture.error is not None:
            raise capture.error

    async def _tick(self) -> None:
        for number in itertools.count():
            now_ns = time.monotonic_ns()
            for data in self.autopilot.due(now_ns):
                self._wires.send_autopilot(data, now_ns)
            if number % _TICKS_A_SEND == 0:
                self._send_due(now_ns)
            await asyncio.sleep(_TICK_S)

    def _send_due(self, now_ns: int) -> None:
        degraded = self.degraded(now_ns)
        self._degraded_log.tell(degraded, now_ns)
        self.outgoing.mavlink.host = self.host.state
        self.outgoing.due(now_ns, degraded, self.scenery(now_ns))
        if self.outgoing.status_due(now_ns, lambda: self.status(now_ns)):
            if news := self._flow.rates.news(now_ns):
                log.info("%s", news)
            self.watchdog.feed(now_ns, f"degraded: {', '.join(degraded)}" if degraded else "ok")

    def _on_message(self, link: Link, frame: MavFrame, now_ns: int) -> None:
        if self._wires.faces_autopilot(link):
            self.autopilot.receive(frame, now_ns)
            if frame.message_id in POSE_IDS:
                self._flow.pose_came()
        if frame.message_id in _COMMAND_IDS:
            self.outgoing.answer(link, frame, now_ns)

    def _publish(self, localised: Localised, targets: list[LocatedTarget]) -> None:
        self.outgoing.publish(localised, targets, time.monotonic_ns())
        self._observer(localised, targets)

    def degraded(self, now_ns: int) -> tuple[Degraded, ...]:
        """Names of what does not work as it should."""
        outputs = ((Degraded.RECORDER, self.recorder), (Degraded.ZENOH, self.zenoh), (Degraded.TAK, self.tak))
        return degraded_names(
            now_ns,
            autopilot=self.autopilot.degraded(now_ns),
            ages=self._ages,
            has_camera=self._has_camera,
            pictures=self.pipeline.gate.degraded(),
            lost=[name for name, part in outputs if part.is_lost],
            is_compass_bad=self.scenery(now_ns).is_bad,
        )

    def scenery(self, now_ns: int) -> SceneryState:
        """What the scenery says now of the reported attitude."""
        return self.pipeline.stage.scenery.state.at(now_ns * 1e-9)

    def status(self, now_ns: int) -> StatusReport:
        """The status message."""
        degraded = self.degraded(now_ns)
        time_utc_s, _ = self.autopilot.utc_s(now_ns)
        return StatusReport(
            vehicle=self.config.vehicle,
            time_utc=utc_text(time_utc_s),
            state="degraded" if degraded else "ok",
            degraded=list(degraded),
            counters=self.counters(),
            scenery=report_from_scenery(self.scenery(now_ns)),
            explain=report_from_explanation(self.pipeline.stage.explanation),
            host=self.host.state,
        )

    @property
    def rejects(self) -> Counter[RejectReason]:
        """Frames that were not used, by reason."""
        return self.pipeline.rejects + Counter(dict(self._source.rejected))

    def _utc_s(self) -> float:
        """Now, by the autopilot's GPS time where that is known; any thread may ask."""
        return self.autopilot.utc_s(time.monotonic_ns())[0]

    def counters(self) -> dict[str, Any]:
        """What the status carries."""
        stage = self.pipeline.stage
        return {
            "autopilot": self.autopilot.counters(),
            "links": self._wires.counters(),
            "commands": dict(self.outgoing.mavlink.commands),
            "commands_refused_of": sorted(self.outgoing.mavlink.refused_systems),
            "frames": {
                "localised": stage.frames,
                "dropped": self.frames.dropped,
                "not_followed": self.follower.skipped,
                "per_second": self._flow.rates.per_second(time.monotonic_ns()),
            },
            "rejects": {str(reason): count for reason, count in sorted(self.rejects.items())},
            "segmenter": stage.segmenter.name,
            "accelerator": asdict(self.accelerator.state),
            "ground": stage.ground.counters(),
            "zenoh": self.zenoh.counters,
            "tak": self.tak.counters,
            "klv": self.outgoing.klv.counters,
            "recorder": self.recorder.counters,
            "tracks": self.keeper.counters(),
        }
