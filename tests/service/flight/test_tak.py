"""[tak] in the real service: what it publishes reaches a server; one that fails is degraded and holds up nothing."""

import asyncio

import pytest

from service.common.degraded import Degraded
from service.config.sections import Config, LinkConfig, MavlinkConfig, TakConfig, ZenohConfig
from service.flight.app import App
from service.publish.exchange.tak import link
from service.publish.wire import report_from_target
from tests.support.ports import free_port
from tests.support.running_app import run, until
from tests.support.tak_server import Server
from tests.support.wire_samples import located


def config(*urls: str) -> Config:
    links = (LinkConfig(url="udpin:127.0.0.1:0"),)
    return Config(mavlink=MavlinkConfig(links=links), zenoh=ZenohConfig(enabled=False), tak=TakConfig(urls=urls))


def test_a_flight_publishes_to_a_server_and_says_which_one_it_does_not_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "_TICK_S", 0.02)

    async def body() -> None:
        nobody = f"tcp://127.0.0.1:{free_port()}"
        with Server() as server:
            app = App(config(f"tcp://127.0.0.1:{server.port}", nobody))
            stop = asyncio.Event()
            serving = asyncio.create_task(app.run(stop))
            await until(lambda: app.links[0].state == "open" or serving.done(), "the link")
            now_s = app._utc_s()
            target = located()
            fresh = type(target)(
                **{name: getattr(target, name) for name in target.__slots__}
                | {"time_utc_s": now_s, "last_seen_utc_s": now_s}
            )
            app.tak.tell_fire(app.outgoing._own_fires.shared(fresh, report_from_target(fresh, "drone1")))
            await until(lambda: len(server.events()) >= 2, "the fire")
            await until(lambda: Degraded.TAK in app.degraded(0), "degraded")
            counters = app.counters()["tak"]
            assert counters[nobody]["faults"] == {
                "connection refused": counters[nobody]["faults"]["connection refused"]
            }
            assert counters[f"tcp://127.0.0.1:{server.port}"]["state"] == "connected"
            stop.set()
            await serving
            await until(lambda: len(server.events()) >= 3, "the region is taken back")

    run(body())


def test_without_a_url_nothing_is_opened() -> None:
    app = App(config())
    assert app.tak.counters == {} and not app.tak.is_lost
