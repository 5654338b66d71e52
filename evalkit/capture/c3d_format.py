"""Number formats of C3D files: three processors, integer or real.

Layout and codes are those of "The C3D file format user guide", Motion Lab Systems.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

BLOCK = 512
"""C3D files count their positions in blocks of this many bytes, from 1."""

KEY = 0x50
"""Second byte of every C3D file."""

LARGEST = 1e37
"""Beyond any coordinate, and representable by every processor's 4-byte real."""


class Processor(IntEnum):
    """Byte order and real format of a file, by its code in the parameter section."""

    PC = 84
    DEC = 85
    MIPS = 86

    @property
    def order(self) -> str:
        """Byte order of its integers in numpy's notation."""
        return ">" if self is Processor.MIPS else "<"

    @property
    def integer_type(self) -> np.dtype:
        """Its 2-byte signed integer."""
        return np.dtype(self.order + "i2")

    @property
    def real_type(self) -> np.dtype:
        """Its 4-byte real as stored: bit patterns for DEC, whose reals are not IEEE 754."""
        return np.dtype("<u4" if self is Processor.DEC else self.order + "f4")

    @property
    def sign_byte(self) -> int:
        """Which of a real's four bytes holds the sign in its top bit."""
        return {Processor.PC: 3, Processor.DEC: 1, Processor.MIPS: 0}[self]

    def decode(self, stored: NDArray[Any]) -> NDArray[np.float64]:
        """Stored integers or reals of this processor as float64."""
        if stored.dtype.kind == "u":
            return vax_to_float64(stored)
        # A signalling NaN is data here, not an error of ours.
        with np.errstate(invalid="ignore"):
            return stored.astype(np.float64)

    def encode(self, values: ArrayLike, dtype: np.dtype) -> NDArray[Any]:
        """Float64 values as this processor stores them; `dtype` is one of its two types."""
        array = np.asarray(values, dtype=np.float64)
        if dtype.kind == "i":
            return np.rint(array).astype(dtype)
        if dtype.kind == "u":
            return float64_to_vax(array)
        return array.astype(dtype)


def vax_to_float64(stored: NDArray[Any]) -> NDArray[np.float64]:
    """VAX F_floating, read as little-endian 4-byte words, to float64.

    The two 16-bit halves are swapped against IEEE 754 and the exponent is biased by two more. A zero
    exponent is 0, or, with the sign set, the reserved operand: NaN.
    """
    words = np.asarray(stored, dtype=np.uint32)
    bits = (words << np.uint32(16)) | (words >> np.uint32(16))
    exponent = (bits >> np.uint32(23)) & np.uint32(0xFF)
    # The largest exponent is infinity to IEEE 754 but an ordinary number to a VAX: lower it by one first.
    top = exponent == 0xFF
    lowered = np.where(top, bits - np.uint32(1 << 23), bits).view(np.float32)
    values = lowered.astype(np.float64) * np.where(top, 0.5, 0.25)
    empty = exponent == 0
    if empty.any():
        values = np.where(empty, np.where(bits >> np.uint32(31), np.nan, 0.0), values)
    return values


def float64_to_vax(values: NDArray[np.float64]) -> NDArray[Any]:
    """Float64 (at most 8e37 in magnitude) to VAX F_floating as little-endian 4-byte words."""
    quadrupled = (values * 4.0).astype(np.float32)
    bits = np.atleast_1d(quadrupled).view(np.uint32)
    # With a zero exponent a VAX knows only +0; a set sign would be the reserved operand.
    bits = np.where((bits >> np.uint32(23)) & np.uint32(0xFF), bits, np.uint32(0)).reshape(values.shape)
    return ((bits << np.uint32(16)) | (bits >> np.uint32(16))).astype("<u4")
