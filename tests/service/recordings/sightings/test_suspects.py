"""Rows that are far from all others: by their own fire, as a table of fires may span a state or a continent."""

from service.recordings.sightings.suspects import far_apart

HERE, THERE = (34.1, -118.9), (47.3, 8.1)


def test_fires_far_from_each_other_are_each_judged_by_their_own_rows() -> None:
    places, targets = [HERE, HERE, HERE, THERE, THERE], ["a", "a", "a", "b", "b"]
    assert far_apart(places, None, targets) == {}
    assert len(far_apart(places, None)) == 2  # one table without names: two of five are elsewhere


def test_a_row_that_is_swapped_is_known_by_its_fire() -> None:
    found = far_apart([HERE, HERE, THERE, THERE, THERE[::-1]], None, ["a", "a", "b", "b", "b"])
    assert list(found) == [4] and "are swapped: the other rows are near 47.30, 8.10" in found[4]


def test_of_a_fires_two_cameras_its_platforms_other_rows_tell_which_is_wrong() -> None:
    places = [THERE, THERE[::-1], THERE, THERE, HERE]
    found = far_apart(places, None, ["b", "b", "c", "d", "a"], ["x", "y", "y", "x", "z"])
    assert list(found) == [1] and "swapped" in found[1]


def test_where_nothing_tells_nothing_is_said() -> None:
    assert far_apart([HERE, THERE, (-33.0, 151.0)], None, ["a", "a", "a"]) == {}
    assert far_apart([HERE, THERE, (-33.0, 151.0)], None, ["a", "b", "c"]) == {}
    assert far_apart([], None) == {}


def test_home_goes_before_the_rows() -> None:
    assert list(far_apart([HERE, HERE, THERE], THERE, ["a", "a", "a"])) == [0, 1]


def test_a_table_of_thousands_of_torn_fires_is_judged_in_bounded_work() -> None:
    count = 3_000
    found = far_apart([HERE, THERE] * count, None, [str(i // 2) for i in range(2 * count)], ["x"] * (2 * count))
    assert found == {}
