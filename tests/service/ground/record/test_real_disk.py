"""The real ground while it records: killed at any moment, on a disk that is full, on a folder that takes no file."""

import asyncio
import itertools
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import msgspec
import pytest

from service.ground.picture.views import News
from service.ground.record.recorder import NAME, read
from service.publish.wire import decode_report
from service.publish.zenoh import ZenohPublisher
from tests.support.crew_ground import drone, ground
from tests.support.ground_samples import report_bytes
from tests.support.places import HANG_S
from tests.support.told import live, until

numbers = itertools.count(1)  # never one twice, so that each is looked for by itself


def seqs(folder: Path) -> set[int]:
    """Of the reports in the record."""
    found = (one for path in folder.glob("*.jsonl") for one in read(path) if "/targets/" in one.key and one.payload)
    return {decode_report(one.payload).properties.seq for one in found if one.payload}


async def told(address: str, publisher: ZenohPublisher, is_enough: Callable[[News], bool]) -> list[News]:
    """What a page is told, while new reports come, until it is enough."""
    heard: list[News] = []
    async with live(address) as page:
        for seq in numbers:
            publisher.publish_report(1, report_bytes(1, seq=seq))
            heard.append(await until(page, lambda _: True))
            if is_enough(heard[-1]):
                return heard
    raise AssertionError


@pytest.mark.parametrize("more", [1, 9, 17])
def test_after_a_kill_all_that_was_shown_as_recorded_is_in_the_record(tmp_path: Path, more: int) -> None:
    """Killed as soon as so many pictures with a newer "recorded until" were shown."""
    first_s: list[float] = []
    newer: set[float] = set()

    def is_enough(news: News) -> bool:
        first_s.extend([news.now_s] if news.fires else [])
        recorded_s = news.ground.recorded_s or 0.0
        newer.update([recorded_s] if first_s and recorded_s >= first_s[0] else [])
        return len(newer) >= more

    with drone() as (publisher, endpoint), ground("--connect", endpoint, "--record", str(tmp_path)) as served:
        heard = asyncio.run(told(served.address, publisher, is_enough))
        served.process.kill()
        served.process.wait(HANG_S)
    until_s = heard[-1].ground.recorded_s
    assert until_s is not None
    shown = {fire.seq for news in heard if news.now_s <= until_s for fire in news.fires}
    assert shown and shown <= seqs(tmp_path)


def days(folder: Path) -> list[Path]:
    """The record's file of today; and tomorrow's, as a test may run at midnight."""
    return [folder / NAME.format(datetime.now(timezone.utc) + timedelta(days=day)) for day in (0, 1)]


@pytest.mark.parametrize(
    ("spoil", "mend", "words"),
    [
        (lambda path: path.symlink_to("/dev/full"), Path.unlink, "No space left on device"),
        (Path.mkdir, Path.rmdir, "Is a directory"),
    ],
)
def test_a_disk_that_takes_nothing_is_told_the_picture_goes_on_and_nothing_is_missing_once_it_does(
    tmp_path: Path, spoil: Callable[[Path], None], mend: Callable[[Path], None], words: str
) -> None:
    for path in days(tmp_path):
        spoil(path)
    with drone() as (publisher, endpoint), ground("--connect", endpoint, "--record", str(tmp_path)) as served:
        faults = asyncio.run(told(served.address, publisher, lambda news: bool(news.ground.record_fault)))
        assert (faults[-1].ground.record_fault, faults[-1].ground.recorded_s) == (words, None)
        last = max(fire.seq for news in faults for fire in news.fires) if any(one.fires for one in faults) else 0
        goes_on = asyncio.run(told(served.address, publisher, lambda news: any(one.seq > last for one in news.fires)))
        assert goes_on[-1].ground.record_fault == words
        for path in days(tmp_path):
            mend(path)
        mended = asyncio.run(told(served.address, publisher, lambda news: news.ground.recorded_s is not None))
        assert not mended[-1].ground.record_fault and mended[-1].ground.record_lost == 0
        until_s = mended[-1].ground.recorded_s
    shown = {one.seq for news in (*faults, *goes_on, *mended) if news.now_s <= (until_s or 0.0) for one in news.fires}
    assert shown and shown <= seqs(tmp_path)


def test_marks_that_cannot_be_kept_are_a_fault_and_hold_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "marks.json.part").mkdir()

    async def run(address: str) -> None:
        async with live(address) as page:
            await until(page, lambda news: bool(news.fires))
            await page.send_str(
                msgspec.json.encode({"vehicle": "drone1", "target": 1, "time_s": 0, "name": "Mill"}).decode()
            )
            news = await until(page, lambda news: any(one.mark for one in news.fires))
            assert (await until(page, lambda news: bool(news.ground.record_fault))).ground.record_fault
            assert news.fires[0].mark is not None and news.fires[0].mark.name == "Mill"

    with drone() as (publisher, endpoint), ground("--connect", endpoint, "--record", str(tmp_path)) as served:
        publisher.publish_report(1, report_bytes(1))
        asyncio.run(run(served.address))
