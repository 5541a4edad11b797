"""Drones that publish as the service does, each with its own zenoh session: what the ground is loaded with.

A process of its own, so that the one that measures has time to.
"""

import multiprocessing
import time
from multiprocessing.connection import Connection
from typing import Self

import msgspec
import numpy as np

from distloc.types import Ellipse, Extent, Plume, TargetEstimate, TargetState
from service.common.messages import Geodetic, LocatedTarget
from service.config.sections import ZenohConfig
from service.publish.wire import Report, StatusReport, VehicleReport, encode, report_from_target, utc_text
from service.publish.zenoh import ZenohPublisher

LAT_DEG, LON_DEG = 47.4, 8.6
_SPREAD_DEG = 0.3
_STATES = (TargetState.CONFIRMED, TargetState.TENTATIVE, TargetState.COASTING)
_SEEN_FOR_S = 3_600.0
_WAIT_S = 60.0


class Crowd:
    """So many drones, each with so many fires, that tell of all of them once a second; open in a `with`."""

    def __init__(self, endpoint: str, drones: int, fires: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_publish, args=(theirs, endpoint, drones, fires), daemon=True)
        self._process.start()
        theirs.close()

    def published(self) -> int:
        """Reports until now; RuntimeError where the process does not answer."""
        self._pipe.send(None)
        if not self._pipe.poll(_WAIT_S):
            raise RuntimeError(f"the simulated drones said nothing for {_WAIT_S:.0f} s")
        return int(self._pipe.recv())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()


def fire(vehicle: str, target: int, state: TargetState, lat_deg: float, lon_deg: float) -> Report:
    """A report as the service makes it, of a fire that has been seen for an hour."""
    now_s = time.time()
    estimate = TargetEstimate(
        id=target,
        state=state,
        position_enu_m=np.array([4000.0, 0.0, 100.0]),
        covariance_enu_m2=np.diag([5400.0, 600.0, 100.0]),
        ellipse95=Ellipse(180.0, 60.0, 1.2),
        vertical95_m=19.6,
        region95=Ellipse(220.0, 100.0, 1.2),
        extent=Extent(40.0, 4.0, 80.0, 8.0),
        range_m=4100.0,
        range95_m=(3900.0, 4300.0),
        bearing_rad=1.2,
        existence=0.98,
        observations=12,
        misses=1,
        baseline_m=350.0,
        first_seen_s=0.0,
        last_seen_s=_SEEN_FOR_S,
        degraded=(),
        aim="base",
        motion="fixed",
        plume=Plume(np.array([4030.0, 10.0, 160.0]), 0.4, 1.4),
    )
    smoke = Geodetic(lat_deg + 0.001, lon_deg + 0.001, 572.0)
    place = Geodetic(lat_deg, lon_deg, 512.0)
    times_s = (now_s, "gps", now_s - _SEEN_FOR_S, now_s)
    return report_from_target(LocatedTarget(estimate, place, 560.0, 0, 0, *times_s, (), smoke), vehicle)


def _again(report: Report, lat_deg: float, lon_deg: float, seq: int) -> Report:
    """The same fire, seen anew at another place."""
    assert report.geometry is not None
    now = utc_text(time.time())
    replace = msgspec.structs.replace
    return replace(
        report,
        geometry=replace(report.geometry, coordinates=[lon_deg, lat_deg, *report.geometry.coordinates[2:]]),
        properties=replace(report.properties, time_utc=now, last_seen_utc=now, seq=seq),
    )


class _Drone:
    def __init__(self, name: str, endpoint: str, fires: int, rng: np.random.Generator) -> None:
        self._name, self._rng = name, rng
        self._publisher = ZenohPublisher(ZenohConfig(mode="client", connect=(endpoint,)), name)
        self._publisher.open()
        self._places_deg = np.array([LAT_DEG, LON_DEG]) + rng.uniform(-_SPREAD_DEG, _SPREAD_DEG, (fires + 1, 2))
        self._fires = [
            fire(name, target, _STATES[target % len(_STATES)], *map(float, place))
            for target, place in enumerate(self._places_deg[1:])
        ]

    def tell(self, seq: int) -> int:
        """Where it is, how it is, and each fire a metre from where it was; how many fires."""
        self._places_deg += self._rng.normal(0.0, 1e-5, self._places_deg.shape)
        (lat_deg, lon_deg), *places = self._places_deg.tolist()
        for one, (fire_lat_deg, fire_lon_deg) in zip(self._fires, places, strict=True):
            told = _again(one, fire_lat_deg, fire_lon_deg, seq)
            self._publisher.publish_report(one.properties.target, encode(told))
        now = utc_text(time.time())
        here = VehicleReport(
            vehicle=self._name,
            time_utc=now,
            time_source="gps",
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            altitude_msl_m=900.0,
            heading_deg=70.0,
            footprint=[[lon_deg + east, lat_deg + north] for east, north in ((0.01, 0.02), (0.05, 0.03), (0.05, 0.0))],
        )
        self._publisher.publish_vehicle(encode(here))
        self._publisher.publish_status(encode(StatusReport(vehicle=self._name, time_utc=now, state="ok")))
        return len(places)


def _publish(pipe: Connection, endpoint: str, drones: int, fires: int) -> None:
    rng = np.random.default_rng(0)
    fleet = [_Drone(f"drone{number:03}", endpoint, fires, rng) for number in range(drones)]
    published, due_s, seq = 0, time.monotonic(), 0
    while True:
        for drone in fleet:
            published += drone.tell(seq)
            due_s += 1.0 / drones
            left_s = due_s - time.monotonic()
            if pipe.poll(max(left_s, 0.0)):
                pipe.recv()
                pipe.send(published)
                time.sleep(max(due_s - time.monotonic(), 0.0))
        seq += 1
