"""Checks the checksums of many spans of one buffer at once; the framer asks where junk is full of headers.

MAVLink's CRC-16/MCRF4XX is a cyclic code (Peterson and Brown, Cyclic Codes for Error Detection, Proc. IRE 49, 1961):
bytes and the checksum behind them, as a polynomial, are a multiple of the generator x^16 + x^12 + x^5 + 1. Here the
first bit, the lowest of its byte, is the coefficient of y^0 instead of the highest power, so that the divisor is the
reciprocal R = y^16 + y^11 + y^4 + 1, and a bit's share mod R depends on where it stands, not on what follows. One sum
of the shares up to each byte of the buffer then gives that of any span by a difference. Numbers are polynomials of
degree under 16 (bit i: y^i), sums are XOR.
"""

import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 1 << 15  # of a buffer

_Polynomials = NDArray[np.uint16]


def _times_y8(values: _Polynomials) -> _Polynomials:
    for _ in range(8):
        values = values << np.uint16(1) ^ (values >> np.uint16(15)) * np.uint16(0x0811)
    return values


def _places(first: int) -> _Polynomials:
    """first * y^(8 i) for each byte i of a buffer and for the one behind it."""
    times_y8, value, values = _Y8.tolist(), first, []
    for _ in range(MOST_BYTES + 1):
        values.append(value)
        value = times_y8[value]
    return np.array(values, dtype=np.uint16)


_Y8 = _times_y8(np.arange(1 << 16, dtype=np.uint16))
_BYTES = np.arange(256, dtype=np.uint16)
# By 256 byte + other byte: their product, and that times y^8.
_LOW = np.bitwise_xor.reduce([(_BYTES[:, None] >> bit & 1) * (_BYTES << bit) for bit in range(8)]).ravel()
_HIGH = _Y8[_LOW]
_PLACE, _START = _places(1), _places(0xFFFF)  # the checksum starts from 0xFFFF: its first 16 bits are inverted
_PLACE_LOW, _PLACE_HIGH = (_PLACE & 0xFF).astype(np.intp), (_PLACE >> 8).astype(np.intp)


class Checksums:
    """Checks spans of one buffer of at most `MOST_BYTES`."""

    def __init__(self, data: NDArray[np.uint8]) -> None:
        self._sums = np.zeros(len(data) + 1, dtype=np.uint16)  # of the shares before each byte
        np.bitwise_xor.accumulate(_shares(data, slice(len(data))), out=self._sums[1:])

    def are_right(
        self, starts: NDArray[np.intp], ends: NDArray[np.intp], extras: NDArray[np.uint8]
    ) -> NDArray[np.bool_]:
        """Whether the two bytes at each end are the checksum of the span [start, end) and the extra byte.

        Spans have two bytes or more. The extra byte is not sent: in the polynomial the checksum stands one byte on.
        """
        at_end = self._sums[ends]
        spans = at_end ^ self._sums[starts] ^ _START[starts]
        received = _Y8[self._sums[ends + 2] ^ at_end]
        return np.asarray((spans ^ _shares(extras, ends) ^ received) == 0)


def _shares(values: NDArray[np.uint8], at: NDArray[np.intp] | slice) -> _Polynomials:
    """Of a byte at each of these places."""
    high = values.astype(np.intp) << 8
    return np.asarray(_LOW[high | _PLACE_LOW[at]] ^ _HIGH[high | _PLACE_HIGH[at]])
