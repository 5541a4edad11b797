"""Two grounds show the same and share marks, whoever comes late; a record is shown again; bad input is one line."""

import asyncio
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aiohttp
import msgspec

from service.ground.picture.marks import Mark
from service.ground.picture.views import News
from service.ground.record.recorder import Recorder
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import NOW_S, heard, report_bytes, vehicle_bytes
from tests.support.places import HANG_S, ROOT
from tests.support.ports import free_port
from tests.support.told import live, until


def shows(target: int) -> Callable[[News], bool]:
    return lambda news: f"drone1/{target}" in {one.id for one in news.fires}


def test_two_grounds_and_a_late_page_show_the_same_and_a_mark_at_one_is_at_all(tmp_path: Path) -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"

    async def run(first: str, second: str) -> None:
        async with live(first) as one, live(second) as other:
            for socket in (one, other):
                await until(socket, shows(3))
            mark = Mark(vehicle="drone1", target=3, time_s=0.0, name="Mill", is_acknowledged=True)
            await one.send_str(msgspec.json.encode(mark).decode())
            news = await until(other, lambda news: any(one.mark for one in news.fires))
            assert news.fires[0].mark is not None and news.fires[0].mark.name == "Mill"
            async with live(second) as late:
                whole = await until(late, lambda _: True)
                assert whole.kind == "all" and [one.id for one in whole.fires] == ["drone1/3"]
                assert whole.fires[0].mark == news.fires[0].mark

    with drone() as (publisher, endpoint):
        publisher.publish_report(3, report_bytes(3))
        here = ("--connect", endpoint, "--record", str(tmp_path / "a"))
        with (
            ground(*here, "--listen", meet) as first,
            ground("--connect", endpoint, "--connect", meet) as second,
        ):
            asyncio.run(run(first.address, second.address))
            deadline = time.monotonic() + HANG_S
            while not (tmp_path / "a" / "marks.json").exists() and time.monotonic() < deadline:
                time.sleep(0.05)
        with (
            ground(*here, "--listen", meet) as again,  # started again it knows its marks, and tells them who asks
            ground("--connect", endpoint, "--connect", meet, "--record", str(tmp_path / "b")) as third,
        ):

            async def reread(address: str) -> None:
                async with live(address) as one:
                    await until(one, lambda news: any(fire.mark for fire in news.fires))

            asyncio.run(reread(again.address))
            asyncio.run(reread(third.address))
            third.process.terminate()
            third.process.wait(HANG_S)
        assert "Mill" in (tmp_path / "b" / "marks.json").read_text()  # another ground's, kept as well


def test_a_record_is_shown_again_and_the_time_line_leads_back(tmp_path: Path) -> None:
    with Recorder(tmp_path, 1_000_000) as recorder:
        for second in range(40):
            state = "tentative" if second < 20 else "confirmed"
            at_s = NOW_S + second
            recorder.append(heard("drone1/targets/3", report_bytes(3, state=state, at_s=at_s), at_s))
            recorder.append(heard("drone1/vehicle", vehicle_bytes(at_s=at_s, lat_deg=47.41 + second * 1e-3), at_s))
    (path,) = tmp_path.glob("*.jsonl")

    async def run(address: str) -> None:
        async with aiohttp.ClientSession() as session, live(address) as one:
            news = await until(one, lambda news: any(fire.state == "confirmed" for fire in news.fires))
            assert news.ground.replay == path.name and news.now_s < NOW_S + 60.0
            while news.now_s < NOW_S + 39.0:
                news = await until(one, lambda _: True)
            for at_s, state in ((NOW_S + 12.0, "tentative"), (NOW_S + 39.0, "confirmed")):
                async with session.get(f"{address}past?t={at_s}") as answer:
                    past = msgspec.json.decode(await answer.read(), type=News)
                    assert past.fires[0].state == state and past.now_s <= at_s

    with ground("--replay", str(path), "--speed", "20") as served:
        asyncio.run(run(served.address))


def test_a_mission_is_exported_and_a_config_may_say_where_to_connect(tmp_path: Path) -> None:
    with Recorder(tmp_path, 1_000_000) as recorder:
        recorder.append(heard("drone1/targets/3", report_bytes(3)))
    (path,) = tmp_path.glob("*.jsonl")
    command = [sys.executable, "-m", "service", "ground", "--replay", str(path), "--export", str(tmp_path / "m.html")]
    subprocess.run(command, cwd=ROOT, capture_output=True, timeout=HANG_S, check=True)
    assert "drone1/3" in (tmp_path / "m.html").read_text()
    with drone() as (publisher, endpoint):
        publisher.publish_report(3, report_bytes(3))
        (tmp_path / "ground.toml").write_text(f'[zenoh]\nconnect = ["{endpoint}"]\n')

        async def run(address: str) -> None:
            async with live(address) as one:
                await until(one, shows(3))

        with ground("--config", str(tmp_path / "ground.toml")) as served:
            asyncio.run(run(served.address))


def failed(*arguments: str) -> tuple[int, str]:
    command: list[Any] = [sys.executable, "-m", "service", "ground", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stderr.strip().splitlines()[-1]


def test_a_port_that_is_taken_is_one_line() -> None:
    with drone() as (_, endpoint), ground("--connect", endpoint) as served:
        port = served.address.rstrip("/").rpartition(":")[2]
        status, line = failed("--connect", endpoint, "--port", port)
        taken = f"distloc: 127.0.0.1:{port}: Address already in use: choose another --host or --port"
        assert (status, line) == (1, taken)


def test_a_replay_leaves_the_marks_of_a_record_alone(tmp_path: Path) -> None:
    status, line = failed("--replay", str(tmp_path / "r.jsonl"), "--record", str(tmp_path / "a"))
    assert status == 2 and "leave --record or --replay out" in " ".join(line.split())
    assert not (tmp_path / "a").exists()


def test_another_address_than_this_computers_needs_the_token_that_is_printed() -> None:
    with drone() as (_, endpoint), ground("--connect", endpoint, "--host", "0.0.0.0") as served:
        bare, _, token = served.address.replace("0.0.0.0", "127.0.0.1").partition("?token=")
        assert len(token) >= 32

        async def run() -> None:
            async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
                for address, status in ((bare, 403), (f"{bare}?token={token}", 200), (bare, 200)):
                    async with session.get(address) as answer:
                        assert answer.status == status

        asyncio.run(run())
