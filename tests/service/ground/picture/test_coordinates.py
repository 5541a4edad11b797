"""A place as it is read out; expected values from GeoTrans' published examples and by hand."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.ground.picture.coordinates import place_texts


def test_one_place_four_ways() -> None:
    texts = place_texts(47.42774, 8.60559)
    assert texts.minutes == "47° 25.664' N  008° 36.335' E"
    assert texts.decimal == "47.42774, 8.60559"
    assert (texts.mgrs, texts.utm) == ("32T MT 70254 52774", "32T 470254 E 5252774 N")


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "minutes"),
    [
        (-33.5, -70.25, "33° 30.000' S  070° 15.000' W"),
        (59.99999999, -0.0000001, "60° 00.000' N  000° 00.000' E"),  # no 60 minutes, no zero west
        (0.0, 180.0, "00° 00.000' N  180° 00.000' E"),
    ],
)
def test_minutes_carry_and_signs_are_letters(lat_deg: float, lon_deg: float, minutes: str) -> None:
    assert place_texts(lat_deg, lon_deg).minutes == minutes


def test_the_zones_of_norway_and_the_poles() -> None:
    assert place_texts(60.5, 5.0).utm.startswith("32V")
    assert place_texts(85.0, 5.0).mgrs == place_texts(-81.0, 5.0).utm == ""


def test_a_place_that_the_library_has_no_grid_for_is_told_without() -> None:
    texts = place_texts(-1e-9, 0.0)
    assert (texts.minutes, texts.mgrs, texts.utm) == ("00° 00.000' N  000° 00.000' E", "", "")


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_minutes_tell_the_place_to_two_metres(lat_deg: float, lon_deg: float) -> None:
    for text, angle_deg in zip(place_texts(lat_deg, lon_deg).minutes.split("  "), (lat_deg, lon_deg), strict=True):
        degrees, minutes, letter = text.replace("°", "").replace("'", "").split()
        assert float(minutes) < 60.0
        read_deg = (int(degrees) + float(minutes) / 60.0) * (-1.0 if letter in "SW" else 1.0)
        assert abs(read_deg - angle_deg) <= 0.0005 / 60.0 + 1e-12
