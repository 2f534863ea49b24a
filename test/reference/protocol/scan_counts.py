# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Counts in the data of the blocks of a scan, in NumPy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_driver.protocol.scan_codec import CLASSIC_TAXELS, FD_TAXELS

_FD_BLOCK = np.dtype([("header", "V12"), ("counts", "<u2", FD_TAXELS)])
_SHIFTS = np.arange(4, 64, 12, dtype=np.uint64)


def unpack_counts(fd: bool, wire: bytes | bytearray, out: NDArray[np.uint16]) -> None:
    """Write the counts in the data of all blocks of a scan to `out`, shape [taxels]."""
    if fd:
        out[:] = np.frombuffer(wire, _FD_BLOCK)["counts"].reshape(-1)[: len(out)]
        return
    codes = np.frombuffer(wire, "<u8").reshape(-1, 1) >> _SHIFTS
    padded = np.zeros((len(codes), CLASSIC_TAXELS), np.uint16)
    padded[:] = codes & np.uint64(0xFFFF)  # the code and, above it, 4 bits of its neighbour
    padded <<= 4
    padded |= padded >> 12
    out[:] = padded.reshape(-1)[: len(out)]
