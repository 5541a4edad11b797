"""Several sites: zenoh routers of the Python package, drones and grounds at each, and who may say what."""

import asyncio
import contextlib
import json
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from service.config.sections import ZenohConfig
from service.ground.picture.marks import Mark
from service.ground.picture.views import FireView, News
from service.ground.subscriber import Subscriber
from service.publish.zenoh import ZenohPublisher, zenoh_config
from tests.support.certificates import Authority
from tests.support.crew_ground import ground
from tests.support.ground_samples import report_bytes
from tests.support.places import HANG_S, ROOT
from tests.support.ports import free_port
from tests.support.told import live, until


def opened(config: zenoh.Config, settings: dict[str, object]) -> zenoh.Session:
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@contextlib.contextmanager
def router(*connect: str) -> Iterator[str]:
    """Open to all, linked to others; where it listens."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings: dict[str, object] = {
        "mode": "router",
        "scouting/multicast/enabled": False,
        "listen/endpoints": [endpoint],
        "connect/endpoints": list(connect),
    }
    with opened(zenoh.Config(), settings):
        yield endpoint


def fires(news: News) -> dict[str, FireView]:
    return {one.id: one for one in news.fires}


def test_two_grounds_at_two_routers_show_the_same_five_drones() -> None:
    """Each joins late at its own site; what changes at one site, and what is said at one ground, is at both."""
    ids = {f"drone{number}/1" for number in range(5)}

    async def run(addresses: list[str], publishers: list[ZenohPublisher]) -> None:
        async with contextlib.AsyncExitStack() as stack:
            pages = [await stack.enter_async_context(live(one)) for one in addresses]
            shown = [dict[str, FireView](), dict[str, FireView]()]

            async def both(is_so: str, value: object) -> None:
                for page, known in zip(pages, shown, strict=True):
                    while not ids <= known.keys() or any(getattr(known[one], is_so) != value for one in ids):
                        known.update(fires(await until(page, lambda news: bool(news.fires))))

            await both("state", "confirmed")
            for number, publisher in enumerate(publishers):
                publisher.publish_report(1, report_bytes(1, f"drone{number}", "coasting", seq=8, lat_deg=47.5))
            await both("state", "coasting")
            mark = Mark(vehicle="drone4", target=1, time_s=0.0, name="Mill")
            await pages[0].send_str(json.dumps({"vehicle": "drone4", "target": 1, "time_s": 0.0, "name": "Mill"}))
            for page, known in zip(pages, shown, strict=True):
                while (told := known["drone4/1"].mark) is None or told.name != mark.name:
                    known.update(fires(await until(page, lambda news: bool(news.fires))))
            for one in ids:
                first, second = (known[one] for known in shown)
                assert (first.place, first.seq, first.mark) == (second.place, 8, second.mark)
                assert (first.ellipse95, first.region95) == (second.ellipse95, second.region95)

    with router() as first, router(first) as second, contextlib.ExitStack() as stack:
        publishers = []
        for number in range(5):
            config = ZenohConfig(mode="client", connect=(first if number < 3 else second,))
            publishers.append(stack.enter_context(ZenohPublisher(config, f"drone{number}")))
            publishers[-1].publish_report(1, report_bytes(1, f"drone{number}"))
        grounds = [stack.enter_context(ground("--connect", one)) for one in (first, second)]
        asyncio.run(run([one.address for one in grounds], publishers))


class Site:
    """Routers as docs/zenoh-router.json5 has them, and who connects; only files and endpoints are another's."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack) -> None:
        self.authority, self._stack = Authority(folder / "ca"), stack

    def router(self, name: str, *connect: str) -> str:
        endpoint = f"tls/localhost:{free_port()}"
        certificate, key = self.authority.issue(name)
        settings: dict[str, object] = {"listen/endpoints": [endpoint], "connect/endpoints": list(connect)}
        settings["transport/link/tls/root_ca_certificate"] = str(self.authority.ca)
        for side in ("listen", "connect"):
            settings[f"transport/link/tls/{side}_certificate"] = certificate
            settings[f"transport/link/tls/{side}_private_key"] = key
        config = zenoh.Config.from_file(str(ROOT / "docs" / "zenoh-router.json5"))
        self._stack.callback(opened(config, settings).close)
        return endpoint

    def access(self, name: str, endpoint: str) -> ZenohConfig:
        certificate, key = self.authority.issue(name)
        ca = str(self.authority.ca)
        return ZenohConfig(
            mode="client", connect=(endpoint,), ca_certificate=ca, certificate=certificate, private_key=key
        )

    def session(self, name: str, endpoint: str) -> zenoh.Session:
        session = zenoh.open(zenoh_config(self.access(name, endpoint)))
        self._stack.callback(session.close)
        return session

    def ground(self, name: str, endpoint: str) -> "Heard":
        heard = Heard()
        access = self.access(name, endpoint)
        heard.subscriber = Subscriber(access.connect, heard.take, access=access, on_alive=heard.come)
        self._stack.enter_context(heard.subscriber)
        heard.subscriber.session.declare_subscriber("distloc/*/marks/*", heard.sample)
        return heard


class Heard:
    """What a ground heard: the last of each key, and all."""

    subscriber: Subscriber

    def __init__(self) -> None:
        self.messages: dict[str, bytes] = {}
        self.all: list[tuple[str, bytes]] = []
        self._changed = threading.Condition()

    def take(self, key: str, payload: bytes) -> None:
        with self._changed:
            self.messages[key] = payload
            self.all.append((key, payload))
            self._changed.notify_all()

    def come(self, key: str, is_there: bool) -> None:
        self.take(key, b"there" if is_there else b"gone")

    def sample(self, sample: zenoh.Sample) -> None:
        self.take(str(sample.key_expr), sample.payload.to_bytes())

    def wait(self, key: str, payload: bytes) -> None:
        with self._changed:
            assert self._changed.wait_for(lambda: self.messages.get(key) == payload, HANG_S), self.messages


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with contextlib.ExitStack() as stack:
        yield Site(tmp_path, stack)


def test_the_documented_routers_pass_on_what_may_be_said_and_nothing_else(site: Site) -> None:
    """What may not be is put before what may, over the same link: once the latter is heard, the former never will."""
    south = site.router("router")
    north = site.router("router-north", south)
    drone = ZenohPublisher(site.access("drone1", south), "drone1")
    with drone:
        drone.publish_report(1, b"first")
        crew, crew_north = site.ground("ground", south), site.ground("ground-north", north)
        for one in (crew, crew_north):  # late joiners of both sites
            one.wait("distloc/drone1/targets/1", b"first")
            one.wait("distloc/drone1/alive", b"there")
        forger = site.session("drone2", south)  # let in, but for its own name
        for key in ("distloc/drone1/targets/1", "distloc/drone3/targets/1", "distloc/drone1/alive"):
            forger.put(key, b"forged")
        forger.liveliness().declare_token("distloc/drone3/alive")
        forger.put("distloc/drone2/targets/7", b"true")
        session = crew.subscriber.session  # a ground says what people mean, and no report
        session.put("distloc/drone1/targets/9", b"forged", allowed_destination=zenoh.Locality.REMOTE)
        session.put("distloc/drone1/marks/1", b"mark")
        for one in (crew, crew_north):
            one.wait("distloc/drone2/targets/7", b"true")
        crew_north.wait("distloc/drone1/marks/1", b"mark")
    for one in (crew, crew_north):
        one.wait("distloc/drone1/alive", b"gone")
        reports = {key for key in one.messages if "/marks/" not in key}
        assert reports == {"distloc/drone1/targets/1", "distloc/drone2/targets/7", "distloc/drone1/alive"}
        assert b"forged" not in {payload for _, payload in one.all}


def test_who_has_a_certificate_but_no_policy_says_and_hears_nothing(site: Site) -> None:
    at = site.router("router")
    stranger, listener = site.session("drone9", at), site.session("drone9", at)
    heard: list[str] = []
    listener.declare_subscriber("distloc/**", lambda sample: heard.append(str(sample.key_expr)))
    crew = site.ground("ground", at)
    stranger.put("distloc/drone1/targets/1", b"forged")
    stranger.put("distloc/drone9/targets/1", b"forged")
    with ZenohPublisher(site.access("drone1", at), "drone1") as drone:
        drone.publish_report(1, b"true")
        crew.wait("distloc/drone1/targets/1", b"true")
        assert list(stranger.get("distloc/*/targets/*", timeout=HANG_S)) == []  # though drone1 would answer
    assert b"forged" not in {payload for _, payload in crew.all} and heard == []
