"""`distloc ground`: hears the drones, or a record, keeps the picture and serves it until it is told to stop."""

import asyncio
import contextlib
import os
import secrets
import signal
import socket
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from aiohttp import web

from service.common import aio
from service.config.sections import TakConfig, ZenohConfig
from service.flight.systemd_notify import notify
from service.ground.background.backdrop import Backdrop
from service.ground.faults import GroundError
from service.ground.inbox import Heard, Inbox
from service.ground.link import GroundLink
from service.ground.picture.fires import MOST_FIRES
from service.ground.picture.fleet import MOST_DRONES
from service.ground.picture.fused.fusion import Compared, compared
from service.ground.picture.fused.topic import FusedTopic
from service.ground.picture.marks import Mark, name_of
from service.ground.picture.picture import COMPARE_S, Picture
from service.ground.picture.views import Changed, GroundView
from service.ground.record.kept_marks import KeptMarks
from service.ground.record.recorder import NoRecorder, Recorder
from service.ground.record.replayed import Replayed
from service.ground.record.timeline import Timeline
from service.ground.wall_clock import WallClock
from service.ground.web.access import Access, is_loopback
from service.ground.web.feeds import Feeds
from service.ground.web.hub import Hub
from service.ground.web.site import served, site
from service.publish.exchange.tak.switch import NullTak, make_tak

_TICK_S = 0.1
_MOST_SHARE = 0.1  # of the time goes into comparing: a crowd of fires is compared more rarely
_BEAT_S = 1.0  # news comes so often though there be none: the page knows that it is told
_ASK_S = 30.0
_CLOSE_S = 2.0
_HOST = name_of(socket.gethostname())


@dataclass(frozen=True, slots=True)
class Settings:
    """What the command line says. `record` None: nothing is kept; `replay`: a record's file in place of zenoh."""

    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    access: ZenohConfig | None = None
    host: str = "127.0.0.1"
    port: int = 8080
    token: str = ""
    record: Path | None = None
    most_bytes: int = 4_000_000_000
    replay: Path | None = None
    speed: float = 1.0
    tiles: str | None = None
    dem: Path | None = None
    places: Path | None = None
    attribution: str = ""
    tak: TakConfig = field(default_factory=TakConfig)


class Crew:
    """One ground. `run` serves until `stop`; `address` is where."""

    def __init__(self, settings: Settings, say: Callable[[str], None], clock: WallClock | None = None) -> None:
        self._settings, self._say = settings, say
        self._token = settings.token or ("" if is_loopback(settings.host) else secrets.token_urlsafe(24))
        self._clock = clock or WallClock()
        self._picture, self._timeline, self._inbox = Picture(), Timeline(), Inbox(self._clock.now_s)
        self._backdrop = Backdrop(settings.tiles, settings.dem, settings.places, settings.attribution)
        self._kept_marks = KeptMarks(settings.record)
        self._hub = Hub(self._news, self._on_word)
        self._link: GroundLink | None = None
        self._replayed: Replayed | None = None
        self._tak = make_tak(settings.tak, self._clock.now_s, MOST_FIRES, MOST_DRONES)
        self._told_s = self._compare_s = self._begin_s = 0.0
        self._comparing: asyncio.Future[Compared] | None = None
        self._fused = FusedTopic(_HOST)
        self._is_mark_new = False

    async def run(self, stop: asyncio.Event) -> None:
        """GroundError where port, folder or file cannot be used, zenoh.ZError where zenoh cannot listen."""
        settings = self._settings
        for mark in self._kept_marks.read():
            self._picture.marks.take(mark, self._clock.now_s())
        with contextlib.ExitStack() as stack:
            stack.enter_context(self._backdrop)
            stack.enter_context(self._kept_marks)
            recorder: Recorder | NoRecorder = NoRecorder()
            if settings.replay is not None:
                self._replayed = Replayed(settings.replay, settings.speed)
            else:
                if settings.record is not None:
                    recorder = stack.enter_context(_recorder(settings.record, settings.most_bytes))
                link = GroundLink(settings.connect, settings.listen, settings.access, self._inbox)
                self._link = stack.enter_context(link)
                link.know(self._picture.marks.all())
                stack.enter_context(self._tak)
            async with self._served():
                await self._watch(recorder, stop)

    @contextlib.asynccontextmanager
    async def _served(self) -> AsyncIterator[None]:
        application = site(
            Access(self._token, self._backdrop.origin),
            self._hub,
            self._picture.preview,
            self._timeline.at,
            self._backdrop,
            Feeds(lambda: self._picture.shared(self._now_s()), self._now_s),
            self._on_alert,
        )
        runner = served(application, _CLOSE_S)
        await runner.setup()
        try:
            await self._listen(runner)
            port = runner.addresses[0][1]
            host = f"[{self._settings.host}]" if ":" in self._settings.host else self._settings.host
            self._say(f"the picture is at http://{host}:{port}/" + (f"?token={self._token}" if self._token else ""))
            notify("READY=1")
            yield
        finally:
            await self._hub.close()
            await runner.cleanup()

    async def _listen(self, runner: web.AppRunner) -> None:
        host, port = self._settings.host, self._settings.port
        try:
            await web.TCPSite(runner, host, port).start()
        except OSError as error:
            why = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
            raise GroundError(f"{host}:{port}: {why}: choose another --host or --port") from error

    async def _watch(self, recorder: Recorder | NoRecorder, stop: asyncio.Event) -> None:
        asked_s = -_ASK_S
        while not stop.is_set():
            if self._link is not None and time.monotonic() - asked_s >= _ASK_S:
                asked_s = time.monotonic()
                self._link.ask()
            self._hear(recorder)
            self._publish(recorder, self._now_s())
            with contextlib.suppress(TimeoutError):
                async with aio.timeout(_TICK_S):
                    await stop.wait()

    def _hear(self, recorder: Recorder | NoRecorder) -> None:
        heard, dropped = self._inbox.take()
        step_s = self._clock.follow()  # what was taken has the time of before
        if self._replayed is not None:
            heard, step_s = self._replayed.due(), 0.0
            self._picture.set_clock_on(self._replayed.set_back_s)
        recorder.extend([one for one in heard if self._take(one)])
        self._picture.set_clock_on(step_s)
        for vehicle, count in dropped.items():
            self._picture.refuse(vehicle, "more than can be read", count, self._now_s())

    def _take(self, one: Heard) -> bool:
        if one.payload is None or one.payload == b"":
            self._picture.alive(one.key, one.payload is not None, one.arrived_s)
            return True
        is_taken = self._picture.hear(one.key, one.payload, one.arrived_s, one.sender)
        self._is_mark_new |= is_taken and "/marks/" in one.key
        return is_taken

    def _publish(self, recorder: Recorder | NoRecorder, now_s: float) -> None:
        if self._is_mark_new:  # another ground's: it is kept as ours are
            self._is_mark_new = False
            self._keep()
        linked = {} if self._link is None else self._link.linked()
        self._picture.ground = GroundView(
            links=linked | self._tak.linked,
            recorded_s=recorder.recorded_s,
            record_fault=recorder.fault or self._kept_marks.fault,
            record_lost=recorder.lost,
            replay="" if self._replayed is None else self._replayed.name,
            begin_s=self._timeline.begin_s,
        )
        self._compare(recorder, now_s)
        self._timeline.keep(now_s, lambda: msgspec.json.encode(self._picture.whole(now_s)))
        changed, beat_s = self._picture.changed(), time.monotonic()
        self._tell_tak(changed, now_s)
        if changed or beat_s - self._told_s >= _BEAT_S:
            self._told_s = beat_s
            self._hub.send(changed)

    def _compare(self, recorder: Recorder | NoRecorder, now_s: float) -> None:
        """In a thread of its own, one at a time: what is heard and shown meanwhile does not wait for it."""
        if self._comparing is None:
            if time.monotonic() >= self._compare_s:
                self._begin_s = time.monotonic()
                self._comparing = asyncio.ensure_future(asyncio.to_thread(compared, self._picture.to_compare(now_s)))
        elif self._comparing.done():
            took, self._comparing = self._comparing, None
            self._picture.take_compared(took.result())
            self._compare_s = self._begin_s + max(COMPARE_S, (time.monotonic() - self._begin_s) / _MOST_SHARE)
            self._tell_fused(recorder, now_s)

    def _tell_tak(self, changed: Changed, now_s: float) -> None:
        if isinstance(self._tak, NullTak):
            return
        shared = self._picture.shared_news(changed, now_s)
        for uid in shared.gone:
            self._tak.withdraw(uid)
        for fire in shared.fires:
            self._tak.tell_fire(fire)
        for drone in shared.drones:
            self._tak.tell_drone(drone)

    def _tell_fused(self, recorder: Recorder | NoRecorder, now_s: float) -> None:
        messages = self._fused.messages(self._picture.fused(now_s), now_s)
        recorder.extend([Heard(key, payload, now_s, "") for key, payload in messages])
        if self._link is not None:
            for key, payload in messages:
                self._link.put(key, payload)

    def _on_alert(self, payload: bytes) -> str | None:
        """A tower's alert by HTTP: why not; else it goes the way of all that is heard, and to the other grounds."""
        if self._replayed is not None:
            return "a replay takes no alerts"
        alert = self._picture.take_alert(payload, self._now_s())
        if isinstance(alert, str):
            return alert
        self._inbox.put(alert.key, payload)
        if self._link is not None:
            self._link.put(alert.key, payload)
        return None

    def _news(self, changed: Changed | None) -> str:
        now_s = self._now_s()
        news = self._picture.whole(now_s) if changed is None else self._picture.news(changed, now_s)
        return msgspec.json.encode(news).decode()

    def _on_word(self, text: str) -> None:
        """A page's mark of a fire; what is none is passed over: the page that we serve says nothing else."""
        try:
            mark = msgspec.json.decode(text, type=Mark)
        except (msgspec.MsgspecError, RecursionError):
            return
        told = self._picture.mark(msgspec.structs.replace(mark, ground=_HOST), self._now_s())
        if told is not None:
            self._share(told)

    def _share(self, mark: Mark) -> None:
        self._keep()
        if self._link is not None:
            self._link.tell(mark)

    def _keep(self) -> None:
        marks = self._picture.marks.all()
        self._kept_marks.write(marks)
        if self._link is not None:
            self._link.know(marks)

    def _now_s(self) -> float:
        return self._clock.now_s() if self._replayed is None else self._replayed.now_s


def _recorder(folder: Path, most_bytes: int) -> Recorder:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GroundError(f"--record {folder}: {error.strerror}") from error
    return Recorder(folder, most_bytes)


async def serve(settings: Settings, say: Callable[[str], None]) -> None:
    """Until SIGINT or SIGTERM."""
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    await Crew(settings, say).run(stop)
