"""XMP packets: attributes and elements alike, structures by their names, nothing that blows up."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.recordings.importers.stills.xmp import properties_of
from tests.support.drone_pictures import packet, skydio_attributes, skydio_elements
from tests.support.srt_lines import Moment

AT = Moment(47.0, 8.0, 60.0, 500.0, 10.0, -20.0, 0.5, 10.0)


def test_attributes_and_elements_are_the_same() -> None:
    values = {"GimbalYawDegree": "+12.30", "GimbalPitchDegree": "-4.5"}
    expected = {f"drone-dji:{name}": value for name, value in values.items()}
    for as_elements in (False, True):
        assert properties_of(packet("drone-dji", "http://www.dji.com/drone-dji/1.0/", values, as_elements)) == expected


@pytest.mark.parametrize("write", [skydio_elements, skydio_attributes])
def test_a_structures_parts_go_by_its_name(write) -> None:  # type: ignore[no-untyped-def]
    found = properties_of(write(AT))
    assert float(found["drone-skydio:CameraOrientationNED:Yaw"]) == 10.0
    assert float(found["drone-skydio:CameraOrientationNED:Pitch"]) == -20.0
    assert float(found["drone-skydio:CameraOrientationFLU:Yaw"]) == 9.0
    assert float(found["drone-skydio:Latitude"]) == 47.0


def test_prefixes_need_not_be_declared_and_a_cut_packet_keeps_what_came() -> None:
    whole = packet("drone-dji", "http://www.dji.com/drone-dji/1.0/", {"GimbalYawDegree": "1", "RtkFlag": "50"}, True)
    undeclared = whole.replace(b'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/"', b"")
    assert properties_of(undeclared)["drone-dji:RtkFlag"] == "50"
    assert properties_of(whole[: whole.index(b"<drone-dji:RtkFlag>")]) == {"drone-dji:GimbalYawDegree": "1"}


def test_entities_are_refused() -> None:
    bomb = b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">'
    bomb += b"".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10 if n > 1 else "&a;" * 10}">'.encode() for n in range(1, 30))
    assert properties_of(bomb + b"]><x><drone:Yaw>&a29;</drone:Yaw></x>") == {}
    outside = b'<!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]><x><drone:Yaw>&f;</drone:Yaw></x>'
    assert properties_of(outside) == {}


def test_what_is_deep_long_or_many_is_cut() -> None:
    assert properties_of(b"<a>" * 100_000) == {}
    assert len(properties_of(b"<rdf:RDF>" + b"".join(b"<d:N%d>1</d:N%d>" % (n, n) for n in range(20_000)))) == 5_000
    assert len(properties_of(b"<rdf:RDF><d:N>" + b"1\n" * 500_000 + b"</d:N></rdf:RDF>")["d:N"]) <= 1_000


@settings(max_examples=300, deadline=None)
@given(st.one_of(st.binary(max_size=300), st.text(max_size=300).map(str.encode)))
def test_no_bytes_raise(content: bytes) -> None:
    properties_of(content)
    properties_of(b"<x:xmpmeta>" + content)
