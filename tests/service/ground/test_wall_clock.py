"""The ground's clock may be set at any time: what was heard gets neither older nor fresher for that."""

import asyncio

from service.ground.crew import Crew, Settings
from service.ground.picture.views import News
from service.ground.wall_clock import WallClock
from tests.support.crew_ground import drone
from tests.support.ground_samples import NOW_S, report_bytes, status_bytes
from tests.support.told import live, until

HOUR_S = 3600.0


def test_it_goes_on_steadily_until_it_follows_and_is_told_by_how_much_it_was_set() -> None:
    wall, steady = [NOW_S], [50.0]
    clock = WallClock(lambda: wall[0], lambda: steady[0])
    assert clock.now_s() == NOW_S and clock.follow() == 0.0
    wall[0], steady[0] = NOW_S + 10.0 - HOUR_S, 60.0
    assert clock.now_s() == NOW_S + 10.0
    assert clock.follow() == -HOUR_S and clock.now_s() == wall[0] and clock.follow() == 0.0


def test_a_clock_that_is_only_trimmed_is_followed_in_small_steps() -> None:
    wall, steady = [NOW_S], [0.0]
    clock = WallClock(lambda: wall[0], lambda: steady[0])
    steps = []
    for _ in range(100):
        wall[0] += 1.01
        steady[0] += 1.0
        steps.append(clock.follow())
    assert max(steps) < 0.6 and abs(clock.now_s() - wall[0]) <= 0.5


def test_a_ground_whose_clock_is_set_back_an_hour_calls_nothing_fresh() -> None:
    behind_s = [0.0]
    steady = [0.0]
    clock = WallClock(lambda: NOW_S + steady[0] - behind_s[0], lambda: steady[0])

    async def run() -> None:
        stop, address = asyncio.Event(), asyncio.get_running_loop().create_future()
        with drone() as (publisher, endpoint):
            crew = Crew(Settings(connect=(endpoint,), port=0), lambda line: address.set_result(line.split()[-1]), clock)
            task = asyncio.create_task(crew.run(stop))
            async with live(await address) as page:
                publisher.publish_status(status_bytes(at_s=NOW_S))
                publisher.publish_report(3, report_bytes(3, at_s=NOW_S))
                await until(page, lambda news: any(one.state for one in news.drones) and bool(news.fires))
                steady[0], behind_s[0] = 600.0, HOUR_S
                news = await until(page, lambda news: news.now_s < NOW_S and bool(news.fires and news.drones))
                seen_s, quiet_s = ages_s(news)
                assert seen_s == 601.0 and 0.0 <= quiet_s <= 600.0  # a copy of the cache's may come late
            stop.set()
            await task

    asyncio.run(run())


def ages_s(news: News) -> list[float]:
    """Since the fire was seen and since the drone was heard."""
    return [round(news.now_s - (one or 0.0), 3) for one in (news.fires[0].seen_s, news.drones[0].heard_s)]
