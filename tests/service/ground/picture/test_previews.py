"""The last picture of a drone and of each fire that it saw then; bounded."""

from service.ground.picture.picture import Picture
from service.ground.picture.previews import MOST_PREVIEWS, Previews
from tests.support.ground_samples import NOW_S, report_bytes

JPEG = b"\xff\xd8\xff"


def test_a_fire_keeps_the_last_picture_that_was_taken_while_it_was_seen() -> None:
    picture = Picture()

    def second(at_s: float, jpeg: bytes, state: str, seen_s: float) -> None:
        picture.hear("distloc/drone1/targets/3", report_bytes(3, state=state, at_s=seen_s + 1.0), at_s)
        picture.hear("distloc/drone1/preview", JPEG + jpeg, at_s)

    second(NOW_S, b"one", "confirmed", NOW_S - 1.0)
    second(NOW_S + 1.0, b"two", "confirmed", NOW_S)
    assert picture.preview("drone1/3") == JPEG + b"two"
    second(NOW_S + 10.0, b"three", "coasting", NOW_S)
    second(NOW_S + 20.0, b"four", "confirmed", NOW_S)  # told again of what was seen long before
    assert (picture.preview("drone1/3"), picture.preview("drone1")) == (JPEG + b"two", JPEG + b"four")
    (fire,) = picture.whole(NOW_S + 20.0).fires
    assert fire.preview_s == NOW_S + 1.0
    picture.hear("distloc/drone2/targets/3", report_bytes(3, "drone2", at_s=NOW_S + 20.0), NOW_S + 20.0)
    picture.hear("distloc/drone1/preview", JPEG + b"five", NOW_S + 20.0)
    assert picture.preview("drone2/3") is None  # another drone's camera


def test_they_are_bounded_in_number_and_bytes() -> None:
    previews = Previews(most_bytes=1_000)
    for number in range(2 * MOST_PREVIEWS):
        previews.take((f"d{number}/1", f"d{number}"), b"x" * 100, float(number))
    kept = [one for one in range(2 * MOST_PREVIEWS) if previews.jpeg(f"d{one}") is not None]
    assert kept == list(range(2 * MOST_PREVIEWS - 5, 2 * MOST_PREVIEWS))
    for number in range(2 * MOST_PREVIEWS):
        previews.take((f"e{number}",), b"", float(number))
    assert previews.jpeg("e0") is None and previews.taken_s(f"e{MOST_PREVIEWS}") == float(MOST_PREVIEWS)
    for number in range(2 * MOST_PREVIEWS):
        previews.forget(f"e{number}")
    assert previews._bytes == 0
