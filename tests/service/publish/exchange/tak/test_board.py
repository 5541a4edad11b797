"""What is due when, by an injected clock: what a client that hears it all would show, by ATAK's rules."""

from dataclasses import replace
from xml.etree import ElementTree

import msgspec

from service.publish.exchange.drone import SharedDrone
from service.publish.exchange.tak.board import LIFETIME_S, PERIOD_S, Board
from tests.support.ground_samples import NOW_S, ellipse
from tests.support.shared_fires import drawn, seconds, shared
from tests.support.tak_map import Client


def board(most_fires: int = 8, with_tentative: bool = False) -> Board:
    return Board(most_fires, 4, with_tentative)


def uids(target: int) -> set[str]:
    uid = shared(target).uid
    return {uid, f"{uid}.region"}


def test_a_fire_goes_out_at_once_then_each_ten_seconds_and_at_once_where_it_is_another() -> None:
    ours = board()
    ours.tell_fire(shared())
    assert len(ours.due(NOW_S, 8)) == 2 and ours.due(NOW_S + 0.5, 8) == []
    ours.tell_fire(shared())
    assert ours.due(NOW_S + PERIOD_S - 0.1, 8) == [] and len(ours.due(NOW_S + PERIOD_S, 8)) == 2
    for other in (
        shared(state="coasting"),
        replace(shared(), name="Mill"),
        shared(lat_deg=47.4290),
        shared(ellipse95=ellipse(80.0, 60.0, 90.0)),
    ):
        ours = board()
        ours.tell_fire(shared())
        ours.due(NOW_S, 8)
        ours.tell_fire(other)
        assert ours.due(NOW_S + 0.9, 8) == [] and len(ours.due(NOW_S + 1.0, 8)) == 2, other


def test_only_what_is_sure_is_shown_unless_asked_for() -> None:
    ours, asked = board(), board(with_tentative=True)
    for one in (ours, asked):
        one.tell_fire(shared(state="tentative"))
    assert ours.due(NOW_S, 8) == [] and len(asked.due(NOW_S, 8)) == 2


def test_a_dismissed_fire_and_one_that_the_crew_calls_none_are_taken_off_three_times() -> None:
    for gone in (shared(state="dismissed"), replace(shared(), is_no_fire=True)):
        ours, client = board(), Client()
        ours.tell_fire(shared())
        client.hear(ours.due(NOW_S, 8), NOW_S)
        assert client.shows(NOW_S) == uids(3)
        ours.tell_fire(gone)
        sent = [ours.due(NOW_S + 1.0 + after_s, 8) for after_s in (0.0, 1.0, 10.0, 20.0, 30.0, 40.0)]
        assert [len(one) for one in sent] == [3, 0, 3, 3, 0, 0]
        client.hear(sent[0], NOW_S + 1.0)
        assert client.shows(NOW_S + 1.0) == set()


def test_a_server_that_keeps_what_is_not_stale_soon_has_nothing_of_a_fire_that_is_gone() -> None:
    ours, kept = board(), dict[str, float]()
    ours.tell_fire(shared())
    for second in range(100):
        if second == 50:
            ours.tell_fire(shared(state="dismissed"))
        for event in ours.due(NOW_S + second, 8):
            attributes = ElementTree.fromstring(event).attrib
            kept[attributes["uid"]] = seconds(attributes["stale"])
        if second == 49:
            assert uids(3) <= {uid for uid, until_s in kept.items() if until_s > NOW_S + second}
    assert kept[shared().uid] <= NOW_S + 75.0 and kept[f"{shared().uid}.region"] <= NOW_S + 50.0 + 60.0


def test_one_that_nobody_was_told_of_is_not_taken_back() -> None:
    ours = board()
    ours.tell_fire(shared())
    ours.tell_fire(shared(state="dismissed"))
    assert ours.due(NOW_S, 8) == []


def test_one_that_comes_back_is_shown_again() -> None:
    ours, client = board(), Client()
    for fire in (shared(), replace(shared(), is_no_fire=True), shared()):
        ours.tell_fire(fire)
        client.hear(ours.due(NOW_S, 8), NOW_S)
    assert client.shows(NOW_S) == uids(3) and ours.due(NOW_S + 1.0, 8) == []


def test_what_is_not_seen_any_more_fades_by_its_state_and_its_region_is_taken_back() -> None:
    for state, lifetime_s in LIFETIME_S.items():
        ours, client = board(with_tentative=True), Client()
        ours.tell_fire(shared(state=state))
        at_s = NOW_S
        while at_s < NOW_S + lifetime_s - 1.0:
            client.hear(ours.due(at_s, 8), at_s)
            assert client.shows(at_s) == uids(3)
            at_s += 5.0
        for after_s in range(0, 60, 5):
            client.hear(ours.due(at_s + after_s, 8), at_s + after_s)
        assert client.shows(at_s + 30.0) == set(), state
        again = shared(state=state, seen_s=NOW_S - 1.0)  # the drone goes on telling of it, though it is that old
        ours.tell_fire(replace(again, told_s=at_s + 100.0))
        assert ours.due(at_s + 100.0, 8) == []


def test_a_server_that_was_away_for_ten_minutes_gets_what_is_true_then() -> None:
    ours, client = board(), Client()
    for target in (1, 2, 3):
        ours.tell_fire(shared(target))
    client.hear(ours.due(NOW_S, 8), NOW_S)
    back_s = NOW_S + 600.0
    for second in range(600):  # nothing is asked for meanwhile; one is given up, one moves on, one is not heard of
        ours.tell_fire(shared(1, state="dismissed" if second > 100 else "confirmed", seen_s=NOW_S + second))
        ours.tell_fire(shared(2, seen_s=NOW_S + second, lat_deg=47.5 + second * 1e-5))
    ours.tell_fire(shared(4, seen_s=back_s - 1.0))
    ours.begin()
    sent = [event for at in range(20) if (event := ours.due(back_s + at * 0.5, 8))]
    client.hear([one for batch in sent for one in batch], back_s)
    faded_s = NOW_S + 1.5 * LIFETIME_S["confirmed"]  # ATAK's own rule for the marker that was told before
    assert client.shows(back_s + 1.0) == uids(2) | uids(4) | {shared(3).uid}
    assert client.shows(faded_s) == uids(2) | uids(4)
    marker, _ = client.markers[shared(2).uid]
    assert abs(marker.lat_lon[0] - 47.50599) < 1e-6  # the last word, not a queue of six hundred
    assert sum(map(len, sent)) == 8  # two events each of two fires, three to withdraw one, one region taken back
    assert ours.count == 2


def test_it_holds_no_more_than_its_places_and_the_least_urgent_gives_way() -> None:
    ours = board(most_fires=4, with_tentative=True)
    for target in range(100):
        ours.tell_fire(shared(target, state="tentative"))
    for target in range(100, 103):
        ours.tell_fire(shared(target))
    for _ in range(50):
        ours.due(NOW_S, 8)
    assert ours.count == 4 and ours.left_out == 99
    for target in range(200):
        ours.tell_drone(SharedDrone(f"drone{target}", (47.0, 8.0)))
    assert len([one for one in ours.due(NOW_S, 8) if drawn(one).kind == "a-f-A-M-H-Q"]) == 4


def test_a_batch_is_bounded_and_the_sure_come_first() -> None:
    ours = board(most_fires=64, with_tentative=True)
    for target in range(32):
        ours.tell_fire(shared(target, state="tentative" if target % 2 else "confirmed"))
    kinds = []
    for _ in range(10):
        batch = ours.due(NOW_S, 8)
        assert len(batch) <= 9
        kinds += [drawn(one).kind for one in batch]
    assert kinds == 16 * ["a-u-X-i-f-w", "u-d-f"] + 16 * ["a-u-X-i-f-s", "u-d-f"]


def test_many_fires_go_out_less_often() -> None:
    ours = board(most_fires=400)
    for target in range(400):
        ours.tell_fire(shared(target))
    for _ in range(200):
        ours.due(NOW_S, 8)
    assert ours.due(NOW_S + 39.0, 8) == [] and ours.due(NOW_S + 40.0, 8) != []


def test_at_the_end_regions_are_taken_back_as_drawings_never_fade() -> None:
    ours, client = board(), Client()
    ours.tell_fire(shared())
    client.hear(ours.due(NOW_S, 8), NOW_S)
    client.hear(ours.last_words(NOW_S), NOW_S)
    assert client.shows(NOW_S) == {shared().uid}


def test_a_clock_that_is_set_back_stops_nothing() -> None:
    ours = board()
    ours.tell_fire(shared())
    ours.tell_drone(SharedDrone("drone1", (47.0, 8.0)))
    assert len(ours.due(NOW_S, 8)) == 3
    ours.tell_drone(SharedDrone("drone1", (47.1, 8.0)))
    assert len(ours.due(NOW_S - 3_600.0, 8)) == 3


def test_a_drone_goes_out_each_two_seconds_while_it_tells() -> None:
    ours = board()
    sent = []
    for tick in range(20):
        if tick < 10:
            ours.tell_drone(SharedDrone("drone1", (47.0, 8.0)))
        sent.append(len(ours.due(NOW_S + tick * 0.5, 8)))
    assert sum(sent) in (3, 4) and sum(sent[13:]) == 0


def test_a_fire_without_a_place_is_counted_and_not_shown() -> None:
    ours = board()
    lost = shared()
    ours.tell_fire(replace(lost, report=msgspec.structs.replace(lost.report, geometry=None)))
    assert ours.due(NOW_S, 8) == [] and ours.unplaced == 1
