"""A ground's name in its marks: of plain characters, whoever sends it."""

import msgspec
import pytest

from service.ground.picture.marks import Mark, name_of


def test_a_grounds_name_is_of_plain_characters() -> None:
    assert name_of("süd 1<b>.site-a_" + "x" * 100) == ("sd1b.site-a_" + "x" * 40)[:40]
    mark = Mark(vehicle="drone1", target=1, time_s=0.0, ground=name_of("north-1"))
    assert msgspec.json.decode(msgspec.json.encode(mark), type=Mark) == mark
    for name in ("<b>", "x" * 41, "\u202e", "a b"):
        foul = msgspec.structs.replace(mark, ground=name)
        with pytest.raises(msgspec.ValidationError):
            msgspec.json.decode(msgspec.json.encode(foul), type=Mark)
