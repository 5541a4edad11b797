"""Those who listen to the service: a zenoh subscriber and a ground station's MAVLink socket, with the times."""

import json
import select
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import zenoh

from service.mavlink.framer import Framer, decode

STATUSTEXT = 253
_MOST_TEXTS = 1000


@dataclass(frozen=True, slots=True)
class Heard:
    """A message and when it came, in seconds of CLOCK_MONOTONIC."""

    at_s: float
    what: Any


class Operator:
    """Keeps the last status, the last report and the states of each target, and the first STATUSTEXTs.

    `on_report` is called with each report as it comes, on zenoh's thread.
    """

    def __init__(self, endpoint: str, on_report: Callable[[Heard], None] = lambda heard: None) -> None:
        self.status: Heard | None = None
        self.reports: dict[int, Heard] = {}
        self.places: dict[int, tuple[float, float]] = {}  # longitude, latitude
        self.confirmed: set[int] = set()
        self.texts: list[Heard] = []
        self._on_heard = on_report
        self._endpoint = endpoint
        self._changed = threading.Condition()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port = int(self._socket.getsockname()[1])
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="ground", daemon=True)
        self._thread.start()
        self._session: zenoh.Session | None = None
        self.join()

    def join(self) -> None:
        """Subscribe, again after `leave`."""
        self._session = session = zenoh_session(connect=[self._endpoint])
        session.declare_subscriber("distloc/*/status", self._on_status)
        session.declare_subscriber("distloc/*/targets/*", self._on_report)

    def leave(self) -> None:
        """Be gone from zenoh."""
        session, self._session = self._session, None
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]

    def wait_for(self, condition: Callable[[], Any], what: str, limit_s: float) -> Any:
        """The condition's value once it is true; AssertionError with the last status at the deadline."""
        with self._changed:
            value = self._changed.wait_for(condition, limit_s)
        assert value, f"{what}: not within {limit_s} s; last status: {self.status and self.status.what}"
        return value

    def degraded(self) -> tuple[str, ...]:
        """The names in the last status."""
        return () if self.status is None else tuple(self.status.what["degraded"])

    def is_well(self, since_s: float) -> bool:
        """Whether a status that names nothing and a report of a confirmed target both came since then."""
        status, reports = self.status, list(self.reports.values())
        return (
            status is not None
            and status.at_s > since_s
            and not status.what["degraded"]
            and any(report.at_s > since_s and report.what["state"] == "confirmed" for report in reports)
        )

    def texts_since(self, at_s: float) -> list[str]:
        """The STATUSTEXTs heard since then."""
        return [heard.what for heard in self.texts if heard.at_s >= at_s]

    def close(self) -> None:
        """Stop listening."""
        self.leave()
        self._ended.set()
        self._thread.join(5.0)
        self._socket.close()

    def _on_status(self, sample: zenoh.Sample) -> None:
        with self._changed:
            self.status = Heard(time.monotonic(), json.loads(sample.payload.to_bytes()))
            self._changed.notify_all()

    def _on_report(self, sample: zenoh.Sample) -> None:
        at_s = time.monotonic()
        feature = json.loads(sample.payload.to_bytes())
        report = feature["properties"]
        heard = Heard(at_s, report)
        with self._changed:
            self.places[report["target"]] = tuple(feature["geometry"]["coordinates"][:2])
            self.reports[report["target"]] = heard
            if report["state"] == "confirmed":
                self.confirmed.add(report["target"])
            self._changed.notify_all()
        self._on_heard(heard)

    def _listen(self) -> None:
        framer = Framer()
        while not self._ended.is_set():
            if not select.select([self._socket], [], [], 0.1)[0]:
                continue
            for frame in framer.feed(self._socket.recv(65535)):
                if frame.message_id != STATUSTEXT or len(self.texts) >= _MOST_TEXTS:
                    continue
                text = getattr(decode(frame), "text", "")
                with self._changed:
                    self.texts.append(Heard(time.monotonic(), text))
                    self._changed.notify_all()


def zenoh_session(**endpoints: Any) -> zenoh.Session:
    """A session with nothing open but these `listen` or `connect` endpoints; `mode` as zenoh has it."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(endpoints.pop("mode", "peer")))
    for key in ("scouting/multicast/enabled", "scouting/gossip/enabled"):
        config.insert_json5(key, "false")
    for side in ("listen", "connect"):
        config.insert_json5(f"{side}/endpoints", json.dumps(endpoints.get(side, [])))
    return zenoh.open(config)
