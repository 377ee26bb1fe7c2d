"""CRC-32 of a file that is read in pieces: the checksum of the whole from those of its parts."""

from collections.abc import Sequence
from functools import cache

_POLYNOMIAL = 0xEDB88320
_ONE = 1 << 31
"""The polynomial 1: CRC-32 reverses the order of the bits, so x is half of it."""


def combined_crc(crcs: Sequence[int], lengths: Sequence[int]) -> int:
    """Returns the CRC-32 of consecutive parts: the previous sum times x^(8 * length), plus the CRC-32 of the next part.

    Args:
        crcs: (n,) CRC-32 of each part.
        lengths: (n,) bytes of each part.

    Returns:
        The CRC-32 of the whole.

    >>> import zlib
    >>> combined_crc([zlib.crc32(b"a cut"), zlib.crc32(b" file")], [5, 5]) == zlib.crc32(b"a cut file")
    True
    """
    total = 0
    for crc, length in zip(crcs, lengths, strict=True):
        for bit in range(length.bit_length()):
            if length >> bit & 1:
                total = _times(total, _power(bit + 3))
        total ^= crc
    return total


@cache
def _power(bit: int) -> int:
    """Returns x^(2^bit)."""
    return _ONE >> 1 if bit == 0 else _times(_power(bit - 1), _power(bit - 1))


def _times(a: int, b: int) -> int:
    """Returns the product of two polynomials modulo that of CRC-32."""
    product = 0
    while a:
        if a & _ONE:
            product ^= b
        a = a << 1 & 0xFFFFFFFF
        b = b >> 1 ^ (_POLYNOMIAL if b & 1 else 0)
    return product
