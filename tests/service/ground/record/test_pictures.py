"""Pictures in a record: few, back as they were, and the first to be left out where the disk is slow or full."""

from pathlib import Path

from service.ground.inbox import Heard
from service.ground.record.pictures import MOST_DRONES, STEP_S, Pictures
from service.ground.record.recorder import Recorder, read
from tests.support.ground_samples import NOW_S, heard, report_bytes

JPEG = b"\xff\xd8\xff\x00" + bytes(range(256)) * 10


def picture(at_s: float, vehicle: str = "drone1") -> Heard:
    return heard(f"{vehicle}/preview", JPEG, at_s)


def test_one_of_each_drone_every_ten_seconds_is_kept_and_comes_back(tmp_path: Path) -> None:
    with Recorder(tmp_path, 1_000_000) as recorder:
        for second in range(25):
            for vehicle in ("drone1", "drone2"):
                recorder.append(picture(NOW_S + second, vehicle))
            recorder.append(heard("drone1/targets/3", report_bytes(), NOW_S + second))
    (path,) = tmp_path.glob("*.jsonl")
    back = list(read(path))
    shown = [(one.key, one.arrived_s - NOW_S, one.payload) for one in back if one.key.endswith("preview")]
    assert shown == [(f"distloc/{one}/preview", at, JPEG) for at in (0.0, 10.0, 20.0) for one in ("drone1", "drone2")]
    assert len(back) == 25 + 6


def test_they_take_a_quarter_of_the_record_a_day_and_give_way_where_the_disk_is_slow() -> None:
    pictures = Pictures(round(4 * 10 * 4 / 3 * len(JPEG)))
    assert sum(pictures.is_due(picture(NOW_S + STEP_S * n), 0) for n in range(50)) == 10
    assert pictures.is_due(picture(NOW_S + 86_400.0), 0)  # another day
    assert not pictures.is_due(picture(NOW_S + 86_500.0), 1_000)
    assert pictures.is_due(heard("drone1/targets/3", report_bytes()), 1_000)


def test_a_clock_that_was_set_back_stops_none_and_drones_are_bounded() -> None:
    pictures = Pictures(10**12)
    assert pictures.is_due(picture(NOW_S), 0) and pictures.is_due(picture(NOW_S - 5_000.0), 0)
    for number in range(3 * MOST_DRONES):
        assert pictures.is_due(picture(NOW_S, f"d{number}"), 0)
    assert len(pictures._last_s) == MOST_DRONES
