"""Packets of MISB ST 0601 beside two readers and a writer that are not ours."""

import io
import warnings

import pytest
from hypothesis import given
from hypothesis import strategies as st
from stanag4609 import st0601 as other

from service.common import st0601
from service.common.st0601 import Fault, Scale, Tag

STAMP_US = 1_780_000_000_123_456
LINEAR = sorted(tag for tag, item in st0601.ITEMS.items() if isinstance(item, Scale))
EXAMPLE = {tag: 0.3 * item.low + 0.7 * item.high for tag in LINEAR if isinstance(item := st0601.ITEMS[tag], Scale)}


def packet(values: dict[int, float]) -> bytes:
    return st0601.encoded({Tag.TIME_US: STAMP_US, Tag.VERSION: st0601.VERSION, **values}, {})


def resolution(tag: int) -> float:
    item = st0601.ITEMS[tag]
    assert isinstance(item, Scale)
    return (item.high - item.low) / (2 ** (8 * item.size) - 2)


def test_another_reader_reads_each_item_that_is_written() -> None:
    read = other.decode_uas_local_set(packet(EXAMPLE))
    assert read.misp_timestamp_microseconds == STAMP_US
    for tag in LINEAR:
        assert float(read.value(tag)) == pytest.approx(EXAMPLE[tag], abs=0.51 * resolution(tag)), tag


def test_a_second_reader_reads_them_as_well() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # it is of 2018
        from klvdata import StreamParser

        (found,) = StreamParser(io.BytesIO(packet(EXAMPLE)))
        read = {key[0]: str(item.value) for key, item in found.items.items()}
    for tag in set(LINEAR) & {5, 6, 7, 13, 14, 15, 16, 17, 18, 19, 20, 23, 24, 25, 40, 41, 42, 45, 46, 90, 91}:
        assert float(read[tag]) == pytest.approx(EXAMPLE[tag], abs=0.51 * resolution(tag)), tag


def test_what_another_writer_wrote_is_read() -> None:
    items = {2: STAMP_US, 65: 19, 136: 27, 137: -1_500_000, 104: other.IMAPFieldValue(1234.5, 3), 13: 47.25, 5: 359.5}
    read = st0601.decoded(other.encode_uas_local_set(items))
    assert isinstance(read, dict)
    assert read[Tag.SENSOR_HEIGHT_EXTENDED] == pytest.approx(1234.5, abs=0.02)
    assert read[Tag.SENSOR_LAT] == pytest.approx(47.25, abs=1e-7)
    assert read[Tag.HEADING] == pytest.approx(359.5, abs=0.003)
    assert st0601.utc_s(read) == pytest.approx(STAMP_US * 1e-6 - 27.0 - 1.5, abs=1e-6)


def test_error_values_are_not_told() -> None:
    special = other.SpecialValue
    items = {2: STAMP_US, 65: 19, 6: special.OUT_OF_RANGE, 90: special.OUT_OF_RANGE, 13: special.RESERVED, 14: 8.0}
    read = st0601.decoded(other.encode_uas_local_set(items))
    assert isinstance(read, dict)
    assert set(read) == {Tag.TIME_US, Tag.VERSION, Tag.SENSOR_LON}


def test_what_an_item_cannot_say_is_not_written() -> None:
    for tag, value in ((Tag.CE90, 4096.0), (Tag.SENSOR_LAT, 90.1), (Tag.PITCH, -20.5), (Tag.LE90, float("nan"))):
        assert not st0601.holds(tag, value)
        with pytest.raises(ValueError, match="is not from"):
            packet({tag: value})


def test_what_is_wrong_with_a_packet_is_named() -> None:
    good = packet(EXAMPLE)
    spoiled = bytearray(good)
    spoiled[30] ^= 1
    assert st0601.decoded(bytes(spoiled)) is Fault.CHECKSUM
    assert st0601.decoded(good[:-1]) is Fault.LENGTH
    assert st0601.decoded(good + b"\0") is Fault.LENGTH
    assert st0601.decoded(b"") is Fault.LENGTH
    assert st0601.decoded(st0601.encoded({Tag.HEADING: 1.0}, {})) is Fault.NO_TIME
    lying = st0601.KEY + b"\x0a" + b"\x05\x7f\0\0\0\0" + b"\x01\x02"  # item 5 says 127 bytes
    assert st0601.decoded(lying + st0601.checksum(lying).to_bytes(2, "big")) is Fault.LENGTH


@pytest.mark.parametrize("length", [b"\x84\x7f\xff\xff\xff", b"\x88" + b"\xff" * 8, b"\x80", b"\xff", b"", b"\x30"])
def test_a_length_of_gigabytes_takes_nothing_of_what_follows(length: bytes) -> None:
    good = packet({Tag.HEADING: 12.0})
    *lying, found = st0601.packets(b"junk" + st0601.KEY + length + good + b"rest")
    assert found == good
    assert {type(st0601.decoded(one)) for one in lying} <= {Fault}


@given(st.binary(max_size=400))
def test_any_bytes_are_refused_without_an_error(data: bytes) -> None:
    assert isinstance(st0601.decoded(data), Fault)
    body = st0601.KEY + bytes((0x82, (len(data) + 4) >> 8, (len(data) + 4) & 255)) + data + b"\x01\x02"
    read = st0601.decoded(body + st0601.checksum(body).to_bytes(2, "big"))
    assert isinstance(read, Fault) or read[Tag.TIME_US] >= 0
    assert len(st0601.packets(data)) <= len(data) // 17


@given(st.sampled_from(LINEAR), st.floats(0.0, 1.0))
def test_a_value_comes_back_within_its_resolution(tag: int, share: float) -> None:
    item = st0601.ITEMS[tag]
    assert isinstance(item, Scale)
    value = item.low + share * (item.high - item.low)
    read = st0601.decoded(packet({tag: value}))
    assert isinstance(read, dict)
    assert read[tag] == pytest.approx(value, abs=0.51 * resolution(tag))
