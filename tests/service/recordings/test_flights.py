"""The folders of flights: their names, which are deleted and which never, the newest for a replay."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from service.recordings import flights as flights_module
from service.recordings.flights import Flights, flights_in, new_flight, newest_flight, number_of

GB = 10**9


def flight(parent: Path, utc_s: float = 0.0) -> Path:
    """A recorded flight."""
    made = new_flight(parent, utc_s)
    for name in ("telemetry.tlog", "frames.csv", "config.toml"):
        (made / name).write_text("x")
    (made / "frames").mkdir()
    (made / "frames" / "000001.jpg").write_text("x")
    (made / "frames" / ".000002.jpg.part").write_text("x")
    return made


def test_a_name_has_a_rising_number_whatever_the_clock_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    boot = tmp_path / "boot_id"
    boot.write_text("3f2a1b0c-1111-2222-3333-444444444444\n")
    monkeypatch.setattr(flights_module, "BOOT_ID", boot)
    parent = tmp_path / "deep" / "parent"
    names = [new_flight(parent, utc_s).name for utc_s in (1_780_000_002.0, 12.0, 12.0)]
    assert names == [
        "flight-000001-20260528T202642Z-3f2a1b0c",
        "flight-000002-19700101T000012Z-3f2a1b0c",
        "flight-000003-19700101T000012Z-3f2a1b0c",
    ]
    assert [path.name for path in flights_in(parent)] == names
    monkeypatch.setattr(flights_module, "BOOT_ID", tmp_path / "none")
    assert new_flight(parent, 0.0).name.endswith("-00000000")


def test_so_many_flights_are_kept_the_flown_one_among_them(tmp_path: Path) -> None:
    for _ in range(6):
        flight(tmp_path)
    flights = Flights(tmp_path, 3, 0.0)
    while flights.make_room():
        pass
    flown = flights.begin(0.0)
    assert flights.begin(1.0) == flown
    while flights.make_room():
        pass
    assert [number_of(path) for path in flights_in(tmp_path)] == [5, 6, 7]


def test_room_is_made_by_age_and_the_flown_one_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = [flight(tmp_path) for _ in range(4)]
    monkeypatch.setattr(
        flights_module.shutil, "disk_usage", lambda path: SimpleNamespace(free=GB * (5 - len(list(tmp_path.iterdir()))))
    )
    flights = Flights(tmp_path, 100, 2.5 * GB)
    flights.flown = kept[0]
    assert flights.make_room() and flights.make_room() and not flights.make_room()
    assert flights_in(tmp_path) == [kept[0], kept[3]]
    flights = Flights(tmp_path, 100, 1000.0 * GB)
    assert flights.make_room() and flights.make_room()
    with pytest.raises(OSError, match=r"GB free in .*, below recorder\.least_free_gb of 1000"):
        flights.make_room()


def test_only_what_the_recorder_made_is_deleted(tmp_path: Path) -> None:
    parent, elsewhere = tmp_path / "flights", tmp_path / "elsewhere"
    parent.mkdir()
    held = {"annotated": "masks", "noted": "note.txt", "pictured": "frames/holiday.png", "foldered": "frames/x.jpg/y"}
    for file in held.values():
        path = flight(parent) / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    linking = flight(parent)
    shutil.rmtree(linking / "frames")
    elsewhere.mkdir()
    (elsewhere / "1.jpg").write_text("mine")
    (linking / "frames").symlink_to(elsewhere)
    shutil.move(flight(parent), elsewhere / "moved")
    (parent / "flight-000099-20260101T000000Z-00000000").symlink_to(elsewhere / "moved")
    for name in ("flight-1", "flight-000001-20260101T000000Z-0000000g", "holiday", "flight-000001"):
        (parent / name).mkdir()
    (parent / "flight-000098-20260101T000000Z-00000000").write_text("a file")
    before = sorted(tmp_path.rglob("*"))
    flights = Flights(parent, 1, 0.0)
    assert not flights.make_room()
    assert sorted(tmp_path.rglob("*")) == before
    gone = flight(parent)
    assert flights.make_room() and not gone.exists()
    assert sorted(tmp_path.rglob("*")) == before


def test_the_newest_of_a_folder_of_flights_is_taken_and_said(tmp_path: Path) -> None:
    said: list[str] = []
    assert newest_flight(tmp_path, said.append) == tmp_path and not said
    made = [flight(tmp_path, 1e9), flight(tmp_path, 12.0)]
    new_flight(tmp_path, 0.0)  # nothing was recorded there
    assert newest_flight(tmp_path, said.append) == made[1]
    (line,) = said
    assert "holds 2 flights" in line and made[0].name in line and made[1].name in line
    assert newest_flight(made[0], said.append) == made[0] and len(said) == 1
    assert newest_flight(tmp_path / "a.tlog", said.append) == tmp_path / "a.tlog"
