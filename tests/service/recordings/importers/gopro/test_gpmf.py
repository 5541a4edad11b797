"""GPMF packed by its public description, and beside GoPro's own parser where that is installed."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.recordings.importers.gopro.gpmf import streams_of
from tests.support.gopro_films import device, element, nested, stream, text

GYRO = np.array([[0.1, -0.2, 0.3], [1.0, 2.0, -3.0]])


def test_a_stream_is_scaled_and_has_its_notes() -> None:
    payload = device("Camera", stream("GYRO", GYRO, 939.0, text("STNM", "Gyroscope"), text("ORIN", "ZXY")), number=7)
    (found,) = streams_of(payload)
    assert (found.key, found.device, found.device_id) == ("GYRO", "Camera", 7)
    assert (found.text("STNM"), found.text("ORIN"), found.text("none")) == ("Gyroscope", "ZXY", "")
    assert found.values == pytest.approx(GYRO, abs=0.6 / 939.0)
    assert (found.number("SCAL"), found.number("none")) == (939.0, None)


def test_each_column_has_its_own_scale_and_unlike_fields_their_types() -> None:
    rows = [(471234567, -1220000000, 123456, 1500, 3), (471234568, -1220000001, 123457, 1501, 2)]
    data = element("GPSX", "?", rows, "iiIHB")
    scale = element("SCAL", "l", [(10_000_000,), (10_000_000,), (1000,), (100,), (1,)], "i")
    payload = device("d", nested("STRM", text("TYPE", "llLSB"), scale, data))
    (found,) = streams_of(payload)
    assert found.values[0] == pytest.approx([47.1234567, -122.0, 123.456, 15.0, 3.0])
    assert found.values[1] == pytest.approx([47.1234568, -122.0000001, 123.457, 15.01, 2.0])


def test_arrays_in_a_type_and_fixed_point_numbers() -> None:
    payload = device("d", nested("STRM", text("TYPE", "f[2]L"), element("myDD", "?", [(1.5, 2.5, 9)], "ffI")))
    assert streams_of(payload)[0].values.tolist() == [[1.5, 2.5, 9.0]]
    fixed = device("d", nested("STRM", element("QQQQ", "q", [(3 << 15,)], "i")))
    assert streams_of(fixed)[0].values.tolist() == [[1.5]]


def test_what_cannot_be_read_is_left_out() -> None:
    unknown = nested("STRM", element("ABCD", "?", [(1, 2)], "ii"))  # no TYPE
    wrong = nested("STRM", text("TYPE", "ff"), element("ABCE", "?", [(1, 2, 3)], "iii"))
    none = nested("STRM", element("ABCF", "s", [], "hh"))
    zero = nested("STRM", element("SCAL", "s", [(0,)], "h"), element("GOOD", "s", [(7,)], "h"))
    (found,) = streams_of(device("d", unknown, wrong, none, zero))
    assert (found.key, found.values.tolist()) == ("GOOD", [[7.0]])


def test_an_element_that_reaches_beyond_its_own_ends_only_that() -> None:
    lying = struct.pack(">4sBBH", b"GYRO", ord("s"), 255, 65_535) + b"\0" * 8
    good = stream("GYRO", GYRO, 100.0)
    (found,) = streams_of(device("d", nested("STRM", lying), good))
    assert found.values.shape == (2, 3)
    assert streams_of(device("d", good)[:-10]) == []


def test_nests_that_never_end_are_not_followed() -> None:
    inner = stream("GYRO", GYRO, 100.0)
    for _ in range(50):
        inner = nested("STRM", inner)
    assert streams_of(device("d", inner)) == []


@given(st.binary(max_size=600))
def test_any_bytes_end(data: bytes) -> None:
    for payload in (data, device("d", nested("STRM", data + bytes(-len(data) % 4)))):
        for found in streams_of(payload):
            assert found.values.ndim == 2 and found.values.size <= len(payload)


@given(st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 255)), max_size=12))
def test_a_spoiled_payload_ends(changes: list[tuple[int, int]]) -> None:
    data = bytearray(device("Camera", *(stream("GYRO", GYRO, 939.0, text("TYPE", "f[9]L")) for _ in range(3))))
    for at, value in changes:
        data[at % len(data)] = value
    assert len(streams_of(bytes(data))) <= 20
