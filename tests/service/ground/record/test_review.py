"""The review of a mission: one file that asks nobody for anything, with all of it escaped."""

import re
from base64 import b64encode

from service.ground.record.review import review
from tests.support.ground_samples import NOW_S, heard, report_bytes, status_bytes, vehicle_bytes

FOUL = "<script>alert(1)<&'\">"


def test_it_has_the_fires_their_course_and_the_tracks() -> None:
    messages = []
    for second in range(100):
        at_s = NOW_S + second
        state = "tentative" if second < 50 else "confirmed"
        messages += [
            heard("drone1/targets/3", report_bytes(3, state=state, at_s=at_s), at_s),
            heard("drone1/vehicle", vehicle_bytes(at_s=at_s, lat_deg=47.41 + second * 1e-3), at_s),
        ]
    page = review([heard("drone1/alive", b""), *messages], "Mill fire").decode()
    assert "47° 25.664&#x27; N" in page and "32T MT 70254 52774" in page and "180 x 60 m" in page
    assert re.search(r"08:01:40 tentative<br>08:02:30 confirmed", page)
    (track,) = re.findall(r"class='track' points='([^']*)'", page)
    assert len(track.split()) == 100
    (plot,) = re.findall(r"class='line' points='([^']*)'", page)
    assert len(plot.split()) == 100
    assert not re.search(r"\b(src|href)=|url\(|<script", page)


def test_every_string_is_escaped_and_an_empty_record_is_a_page_too() -> None:
    name = FOUL
    messages = [
        heard(f"{name}/targets/1", report_bytes(1, name, degraded=[FOUL], aim=FOUL)),
        heard(f"{name}/status", status_bytes(name, degraded=(FOUL,))),
        heard(f"{name}/vehicle", vehicle_bytes(name)),
        heard(f"{name}/vehicle", b"nonsense"),
    ]
    page = review(messages, FOUL).decode()
    assert "<script" not in page and "&lt;script&gt;" in page and "1 messages refused: not readable" in page
    assert b"No fire was reported" in review([], "empty")


def test_it_has_the_last_picture_of_each_fire_and_says_what_is_fused() -> None:
    jpegs = [b"\xff\xd8\xff" + bytes([n]) * 9 for n in range(3)]
    messages = []
    for second, (state, jpeg) in enumerate(zip(("confirmed", "confirmed", "coasting"), jpegs, strict=True)):
        at_s = NOW_S + 10.0 * second
        messages += [
            heard("drone1/targets/3", report_bytes(3, state=state, at_s=at_s), at_s),
            heard("drone1/preview", jpeg, at_s),
        ]
    messages.append(heard("drone2/targets/5", report_bytes(5, "drone2"), NOW_S + 21.0))
    page = review(messages, "Mill fire").decode()
    assert re.findall(r"src='data:image/jpeg;base64,([^']*)'", page) == [b64encode(jpegs[1]).decode()]
    assert "drone1&#x27;s camera at 2027-01-15 08:01:50 UTC" in page
    assert "drone1/3 (part of fused/drone1/3)" in page
    assert "fused/drone1/3 (fused of drone1/3, drone2/5)" in page
    assert "1 fires reported by 2 drones" in page


def test_its_size_is_bounded() -> None:
    messages = (
        heard("drone1/targets/3", report_bytes(3, at_s=NOW_S + number), NOW_S + number) for number in range(3000)
    )
    assert len(review(messages, "long")) < 60_000
