"""The whole service with a spoilable autopilot, camera and segmenter, and an operator who notes what is heard."""

import asyncio
import contextlib
import json
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from service.camera.sources import CaptureSource
from service.config.sections import (
    Config,
    LinkConfig,
    LocaliserSection,
    MavlinkConfig,
    RecorderConfig,
    SegmenterConfig,
    ZenohConfig,
)
from service.flight.app import App
from service.simulator.craft import CraftOnAir
from service.simulator.operator import Operator
from service.simulator.scenario import centre_enu_m
from tests.faults.device import Device
from tests.faults.scene import ROUND_THE_PLUME
from tests.support.places import HANG_S
from tests.support.ports import free_port

MOST_ERROR_M = 250.0  # of the target once all is well, at 0.9 km: it has 80 m at most where nothing was spoilt
CONTRACT_S = 10.0  # to recover, from the fault's end: held where it is measured, for docs/faults.md
OUT = "DISTLOC_FAULTS_OUT"  # the file that outcomes are added to
RECOVERED_S = CONTRACT_S if OUT in os.environ else HANG_S


@dataclass(slots=True)
class Outcome:
    """One fault: what the operator saw while it lasted, and how long after its end all was well again."""

    fault: str
    degraded: list[str]
    rejects: list[str]
    texts: list[str]
    recovered_s: float = float("nan")
    error_m: float = float("nan")


class Flight:
    """One flight of the service; `with` opens and closes it all."""

    def __init__(
        self, *, router: str = "", recording: Path | None = None, boot_ns: int | None = None, has_camera: bool = True
    ) -> None:
        self.endpoint = endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._stack = contextlib.ExitStack()
        self.operator = self._opened(Operator(endpoint))
        links = (
            LinkConfig(url="udpin:127.0.0.1:0"),
            LinkConfig(url=f"udpout:127.0.0.1:{self.operator.port}", faces="ground"),
        )
        config = Config(
            camera=ROUND_THE_PLUME.camera,
            mavlink=MavlinkConfig(links=links),
            localizer=LocaliserSection(n_particles=20_000),
            segmenter=SegmenterConfig(kind="classical"),  # finds what is drawn, and leaves a busy computer time
            zenoh=ZenohConfig(listen=(endpoint,), connect=(router,) if router else ()),
            recorder=RecorderConfig(folder="" if recording is None else str(recording)),
        )
        start_ns = time.monotonic_ns()
        self.device = self._opened(Device(ROUND_THE_PLUME, start_ns, has_camera))
        source = CaptureSource(
            "the test's device",
            0,
            time.monotonic_ns,
            config.camera.camera(),
            open_capture=self.device.open,  # type: ignore[arg-type]
            is_awaited=True,
        )
        self.app = App(config, source=source)
        self._stop = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._serve, name="service", daemon=True)
        self._thread.start()
        self._stack.callback(self._end)
        self._until(lambda: self.app.links[0].state == "open", "the service listens")
        self.air = self._opened(CraftOnAir(ROUND_THE_PLUME, self.app.links[0].port, start_ns, boot_ns))
        self.target = 0

    def __enter__(self) -> "Flight":
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def confirm(self) -> int:
        """Wait until a target is confirmed and nothing is degraded; its id."""
        (self.target,) = self.operator.wait_for(
            lambda: self.operator.confirmed if self._is_well(0.0) else None, "a target is confirmed", HANG_S
        )
        return self.target

    @contextlib.contextmanager
    def fault(
        self,
        name: str,
        *,
        degraded: str = "",
        reject: str = "",
        is_from_start: bool = False,
        most_error_m: float = MOST_ERROR_M,
    ) -> Iterator["Fault"]:
        """Spoil something inside: on leaving, all must be well again in time, with the same target and no other.

        `degraded` and `reject` must be seen before it is mended. Of a fault from the start only the end is looked at.
        """
        if not is_from_start:
            self.target = self.target or self.confirm()
            self._wait_well(time.monotonic(), "well before the fault", HANG_S)
        fault = Fault(self, Outcome(name, [], [], []))
        try:
            yield fault
            if degraded:
                fault.see_degraded(degraded)
            if reject:
                fault.see_reject(reject)
        finally:
            fault.mend()
        ended_s = time.monotonic()
        if is_from_start:
            self.confirm()
        self._wait_well(ended_s, f"well again after {name}", RECOVERED_S)
        left_s = RECOVERED_S - (time.monotonic() - ended_s)
        self.operator.wait_for(fault.is_over, f"{name} is over", left_s)
        fault.outcome.recovered_s = round(time.monotonic() - ended_s, 1)
        fault.see_all_clear()
        self._judge(fault, most_error_m)

    def _judge(self, fault: "Fault", most_error_m: float) -> None:
        outcome = fault.outcome
        outcome.error_m = round(self.error_m())
        assert self.operator.reports[self.target].what["state"] in ("confirmed", "coasting")
        assert self.operator.confirmed == {self.target}, f"{outcome.fault} made a target: {self.operator.confirmed}"
        assert outcome.error_m < most_error_m
        if out := os.environ.get(OUT):
            with Path(out).open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(outcome)) + "\n")

    def rejects(self) -> dict[str, int]:
        """Frames that were not used, by reason, and so the autopilot's messages."""
        counters: dict[str, Any] = self.operator.status.what["counters"] if self.operator.status else {}
        return counters.get("rejects", {}) | counters.get("autopilot", {}).get("rejects", {})

    def error_m(self) -> float:
        """How far the target's last report is from the truth, on the ground."""
        scene, report = ROUND_THE_PLUME, self.operator.reports[self.target].what
        lon_deg, lat_deg = self.operator.places[self.target]
        offset_m = scene.frame.enu_from_geodetic(lat_deg, lon_deg, report["altitude_msl_m"])
        return float(np.hypot(*(offset_m - centre_enu_m(scene.targets[0]))[:2]))

    def _wait_well(self, since_s: float, what: str, limit_s: float) -> None:
        self.operator.wait_for(lambda: self._is_well(since_s), what, limit_s)

    def _is_well(self, since_s: float) -> bool:
        """Whether a status without faults and a report of the target, confirmed, both came since then."""
        status, report = self.operator.status, self.operator.reports.get(self.target or 1)
        return bool(
            status
            and report
            and min(status.at_s, report.at_s) > since_s
            and not status.what["degraded"]
            and report.what["state"] == "confirmed"
        )

    def _opened(self, part: Any) -> Any:
        self._stack.callback(part.close)
        return part

    def _serve(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self.app.run(self._stop))
        self._loop.close()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(HANG_S)
        assert not self._thread.is_alive(), "the service did not end"

    def _until(self, condition: Any, what: str) -> None:
        self.operator.wait_for(lambda: condition() or not self._thread.is_alive(), what, HANG_S)


class Fault:
    """A fault while it lasts."""

    def __init__(self, flight: Flight, outcome: Outcome) -> None:
        self.outcome = outcome
        self.began_s = time.monotonic()
        self._flight = flight
        self._rejects_before = flight.rejects()
        self._mend: Any = lambda: None
        self.is_over: Any = lambda: True  # what else must hold within the time to recover

    def ends_with(self, mend: Any) -> None:
        """What ends the fault, called once its signs were seen."""
        self._mend = mend

    def mend(self) -> None:
        """End it."""
        self._mend()

    def see_degraded(self, name: str) -> None:
        """Wait for a name in the status and for the STATUSTEXT that tells it."""
        operator = self._flight.operator
        operator.wait_for(lambda: name in operator.degraded(), f"status says {name}", HANG_S)
        operator.wait_for(
            lambda: any(name in text for text in operator.texts_since(self.began_s)), f"STATUSTEXT says {name}", HANG_S
        )
        self.outcome.degraded.append(name)

    def see_reject(self, reason: str) -> None:
        """Wait for a reason's count to rise."""
        before = self._rejects_before.get(reason, 0)
        self._flight.operator.wait_for(
            lambda: self._flight.rejects().get(reason, 0) > before, f"frames rejected: {reason}", HANG_S
        )
        self.outcome.rejects.append(reason)

    def see(self, condition: Any, what: str, limit_s: float = HANG_S) -> None:
        """Wait for anything else that shows."""
        self._flight.operator.wait_for(condition, what, limit_s)

    def see_all_clear(self) -> None:
        """Wait until the pilot is told that all is well, if anything else was told."""
        operator = self._flight.operator
        operator.wait_for(
            lambda: _of_faults(operator.texts_since(self.began_s))[-1:] in ([], ["distloc ok"]),
            "STATUSTEXT says ok",
            HANG_S,
        )
        self.outcome.texts += _of_faults(operator.texts_since(self.began_s))


def _of_faults(texts: list[str]) -> list[str]:
    """Without what is told of targets and of the compass."""
    return [text for text in texts if text.startswith("distloc ")]
