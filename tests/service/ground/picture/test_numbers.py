"""A drone's target numbers begin anew with each flight: what is known of one fire is never taken for another's."""

import msgspec
import pytest

from service.ground.picture.fires import MOST_FIRES_EACH
from service.ground.picture.marks import MOST_EACH, MOST_MARKS, Mark, Marks
from service.ground.picture.picture import Picture
from service.ground.picture.views import FireView
from service.ground.record.review import review
from service.publish.wire import utc_text
from tests.support.ground_samples import NOW_S, heard, report_bytes, status_bytes

KEY, DAY_S = "distloc/drone1/targets/1", 86_400.0
MARK = Mark(vehicle="drone1", target=1, time_s=0.0, is_acknowledged=True, name="Chimney", verdict="not_a_fire")


def told(at_s: float, first_s: float, state: str = "confirmed", lat_deg: float = 47.4, seq: int = 1) -> bytes:
    """A report by a drone's clock."""
    return report_bytes(1, state=state, at_s=at_s, lat_deg=lat_deg, seq=seq, first_seen_utc=utc_text(first_s))


def fires(picture: Picture, now_s: float) -> list[FireView]:
    return sorted(picture.whole(now_s).fires, key=lambda one: one.told_s or 0.0)


def two_flights() -> Picture:
    """Yesterday's number 1, marked, with a picture; and today's, 90 km away."""
    picture = Picture()
    picture.hear(KEY, told(NOW_S, NOW_S - 60.0), NOW_S)
    picture.hear("distloc/drone1/preview", b"\xff\xd8\xffold", NOW_S)
    picture.mark(MARK, NOW_S)
    picture.changes(NOW_S)
    picture.hear(KEY, told(NOW_S + DAY_S, NOW_S + DAY_S - 10.0, lat_deg=48.2), NOW_S + DAY_S)
    return picture


def test_a_number_that_is_used_again_is_another_fire_with_nothing_of_the_firsts() -> None:
    picture = two_flights()
    assert {one.id for one in picture.changes(NOW_S + DAY_S).fires} == {"drone1/1", "drone1/1/20270116T080130"}
    old, new = fires(picture, NOW_S + DAY_S)
    assert (old.lat_deg, old.is_earlier, old.mark is not None) == (47.4, True, True)
    assert (new.lat_deg, new.is_earlier, new.mark) == (48.2, False, None)
    assert picture.preview(old.id) == b"\xff\xd8\xffold" and picture.preview(new.id) is None and new.preview_s is None
    own = picture.mark(msgspec.structs.replace(MARK, verdict="", first_drone_s=new.first_drone_s), NOW_S + DAY_S)
    assert own is not None and own.time_s == NOW_S + DAY_S
    old, new = fires(picture, NOW_S + DAY_S)
    assert [one.mark.verdict for one in (old, new) if one.mark] == ["not_a_fire", ""]


def test_marks_of_each_fire_are_known_again_and_at_another_ground() -> None:
    kept = msgspec.json.decode(msgspec.json.encode(two_flights().marks.all()), type=list[Mark])
    again = Picture()
    for mark in kept:
        assert again.marks.take(mark, NOW_S + DAY_S)
    again.hear(KEY, told(NOW_S + DAY_S, NOW_S + DAY_S - 10.0), NOW_S + DAY_S)
    assert fires(again, NOW_S + DAY_S)[0].mark is None
    other = Picture()
    other.hear(KEY, told(NOW_S + 9.0, NOW_S - 60.4), NOW_S + 9.0)  # the drone reads its clock anew
    assert other.hear("distloc/drone1/marks/1", msgspec.json.encode(kept[0]), NOW_S + 9.0)
    assert fires(other, NOW_S + 9.0)[0].mark == kept[0]


@pytest.mark.parametrize(("marked_s", "is_its"), [(NOW_S - 5.0, True), (NOW_S - DAY_S, False)])
def test_a_mark_that_says_no_time_is_of_no_fire_that_came_after_it(marked_s: float, is_its: bool) -> None:
    picture = Picture()
    picture.marks.take(msgspec.structs.replace(MARK, time_s=marked_s), NOW_S)
    picture.hear("distloc/drone1/status", status_bytes(at_s=NOW_S), NOW_S)
    picture.hear(KEY, told(NOW_S, NOW_S - 60.0), NOW_S)
    assert (fires(picture, NOW_S)[0].mark is not None) == is_its


@pytest.mark.parametrize("step_s", [-3600.0, -8.0, 8.0, 1e7])
def test_a_fire_stays_one_though_the_drones_clock_is_set(step_s: float) -> None:
    """As by GPS after the take-off: all times that it tells are others then."""
    picture = Picture()
    picture.hear(KEY, told(NOW_S, NOW_S - 60.0), NOW_S)
    picture.mark(MARK, NOW_S)
    for second in (1.0, 2.0, 3.0):
        now_s = NOW_S + second
        picture.hear(KEY, told(now_s + step_s, NOW_S - 60.0 + step_s, lat_deg=47.4 + second, seq=0), now_s)
    (fire,) = fires(picture, NOW_S + 3.0)
    assert (fire.id, fire.lat_deg, fire.mark is not None) == ("drone1/1", 50.4, True)


def test_given_up_is_the_last_word_whatever_the_clock_and_a_late_copy_does_not_undo_it() -> None:
    picture = Picture()
    picture.hear(KEY, told(NOW_S, NOW_S - 60.0, seq=7), NOW_S)
    picture.hear(KEY, told(NOW_S - 7.0, NOW_S - 60.0, "dismissed", seq=7), NOW_S + 1.0)
    assert fires(picture, NOW_S + 1.0)[0].state == "dismissed"
    picture.hear(KEY, told(NOW_S - 8.0, NOW_S - 60.0, seq=6), NOW_S + 1.1)
    assert fires(picture, NOW_S + 1.1)[0].state == "dismissed"


def test_a_later_number_of_the_report_is_later_whatever_the_clock() -> None:
    picture = Picture()
    picture.hear(KEY, told(NOW_S, NOW_S - 60.0, seq=7), NOW_S)
    picture.hear(KEY, told(NOW_S - 7.0, NOW_S - 60.0, "coasting", seq=8), NOW_S + 1.0)
    assert fires(picture, NOW_S + 1.0)[0].state == "coasting"


def test_a_late_word_on_the_earlier_fire_is_of_that_one() -> None:
    picture = two_flights()
    picture.hear(KEY, told(NOW_S + 1.0, NOW_S - 60.0, "dismissed"), NOW_S + DAY_S + 1.0)
    assert [one.state for one in fires(picture, NOW_S + DAY_S)] == ["dismissed", "confirmed"]


def test_earlier_fires_are_bounded_and_give_way_first() -> None:
    picture = Picture()
    for flight in range(2 * MOST_FIRES_EACH):
        at_s = NOW_S + 100.0 * flight
        picture.hear(KEY, told(at_s, at_s - 5.0), at_s)
    picture.hear("distloc/drone1/targets/2", report_bytes(2, state="tentative"), at_s)
    left = picture.whole(at_s).fires
    assert len(left) == MOST_FIRES_EACH and "drone1/2" in {one.id for one in left}
    assert sum(not one.is_earlier for one in left) == 2


def test_marks_are_bounded_by_number_and_in_all() -> None:
    marks = Marks()
    for flight in range(3 * MOST_EACH):
        marks.take(
            msgspec.structs.replace(MARK, time_s=NOW_S + flight, first_drone_s=NOW_S + 10.0 * flight), NOW_S + DAY_S
        )
    assert [one.time_s for one in marks.of("drone1/1")] == [NOW_S + 8.0, NOW_S + 9.0, NOW_S + 10.0, NOW_S + 11.0]
    for target in range(2, MOST_MARKS):
        marks.take(msgspec.structs.replace(MARK, time_s=NOW_S, target=target), NOW_S)
    assert len(marks.all()) <= MOST_MARKS and not marks.of("drone1/1")


def test_the_review_tells_the_fires_of_two_flights_apart() -> None:
    messages = []
    for start_s, lat_deg in ((NOW_S, 47.4), (NOW_S + DAY_S, 48.2)):
        messages += [
            heard("drone1/targets/1", told(start_s + second, start_s - 5.0, lat_deg=lat_deg), start_s + second)
            for second in range(3)
        ]
    page = review(messages, "Two flights").decode()
    assert "2 fires reported by 1 drones" in page and "47° 24.000" in page and "48° 12.000" in page
    assert "<h3>drone1/1</h3>" in page and "<h3>drone1/1/20270116T080135</h3>" in page
