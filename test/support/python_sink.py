# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A sink of scans in Python, in the place of a compiled one."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Final

REFUSED, TAKEN, LAST = range(3)
"""What may become of a scan: values of posfet_core/scan_sink.hpp."""
_NAME: Final = b"posfet_core.ScanSink"


class CScan(ctypes.Structure):
    """A scan as in posfet_core/scan.hpp."""

    _fields_ = (
        ("stamp", ctypes.c_int64),
        ("layout", ctypes.c_uint64),
        ("sequence", ctypes.c_uint64),
        ("device_time", ctypes.c_int64),
        ("status", ctypes.c_uint32),
        ("counts", ctypes.POINTER(ctypes.c_uint16)),
        ("taxels", ctypes.c_size_t),
        ("temperatures", ctypes.POINTER(ctypes.c_float)),
        ("sensors", ctypes.c_size_t),
    )


class PythonSink:
    """Hands the scans of a loop to `take`, which says what becomes of each."""

    def __init__(self, take: Callable[[CScan], int]) -> None:
        prototype = ctypes.CFUNCTYPE(ctypes.c_uint8, ctypes.c_void_p, ctypes.POINTER(CScan))
        self._take = prototype(lambda _, scan: take(scan.contents))
        self._sink = (ctypes.c_void_p * 2)(None, ctypes.cast(self._take, ctypes.c_void_p))
        make = ctypes.pythonapi.PyCapsule_New
        make.restype, make.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
        self.capsule: object = make(ctypes.addressof(self._sink), _NAME, None)
        """What a loop is called with, while this object exists."""
