"""A ground that sends to a TAK server: a drone's fire, what the crew says of it, and what is no fire."""

import asyncio
import time

import msgspec

from service.ground.picture.marks import Mark
from service.publish.wire import utc_text
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import report_bytes, vehicle_bytes
from tests.support.tak_server import Server
from tests.support.told import live
from tests.support.told import until as told


def test_a_fire_its_name_and_that_it_is_none_reach_the_server() -> None:
    async def run(address: str, server: Server) -> None:
        async def until(is_so) -> None:  # type: ignore[no-untyped-def]
            deadline = time.monotonic() + 30.0
            while not is_so():
                assert time.monotonic() < deadline, [(one.kind, one.title) for one in server.events()]
                await asyncio.sleep(0.02)

        await until(lambda: len(server.events()) >= 3)
        kinds = {one.kind for one in server.events()}
        assert kinds == {"a-u-X-i-f-w", "u-d-f", "a-f-A-M-H-Q"}
        uid = next(one.uid for one in server.events() if one.kind == "a-u-X-i-f-w")
        async with live(address) as page:
            news = await told(page, lambda news: bool(news.fires))
            assert news.ground.links[f"tcp://127.0.0.1:{server.port}"] is True
            for mark in (
                Mark(vehicle="drone1", target=3, time_s=0.0, name="Mill"),
                Mark(vehicle="drone1", target=3, time_s=0.0, name="Mill", verdict="not_a_fire"),
            ):
                await page.send_str(msgspec.json.encode(mark).decode())
                if mark.verdict:
                    await until(lambda: {uid, f"{uid}.region"} <= {one.removes for one in server.events()})
                else:
                    await until(lambda: any(one.title == "Mill +-180x60m" for one in server.events()))

    with Server() as server, drone() as (publisher, endpoint):
        now_s = time.time()
        publisher.publish_report(3, report_bytes(3, at_s=now_s, first_seen_utc=utc_text(now_s - 60.0)))
        publisher.publish_report(4, report_bytes(4, at_s=now_s, state="tentative"))
        with ground("--connect", endpoint, "--tak", f"tcp://127.0.0.1:{server.port}") as ours:
            for _ in range(100):  # a place is told live only
                publisher.publish_vehicle(vehicle_bytes(at_s=time.time()))
                if any(one.kind == "a-f-A-M-H-Q" for one in server.events()):
                    break
                time.sleep(0.1)
            asyncio.run(run(ours.address, server))
