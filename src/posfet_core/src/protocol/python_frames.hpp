// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Frames as Python has them: tuples of identifier, kind and bytes.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>
#include <limits>

#include "posfet_core/protocol/frame.hpp"

namespace posfet::protocol {

namespace py = pybind11;

/// The data of a frame, which stays as long as the bytes.
inline Frame frame_of(std::uint32_t identifier, unsigned kind, const py::bytes& data) {
  return {identifier, kind, reinterpret_cast<const std::uint8_t*>(PyBytes_AS_STRING(data.ptr())),
          static_cast<std::size_t>(PyBytes_GET_SIZE(data.ptr()))};
}

/// An integer that a frame can have, or the greatest one for another.
inline std::uint32_t number_of(PyObject* number) {
  int overflow = 0;
  const long long value = PyLong_AsLongLongAndOverflow(number, &overflow);
  const bool fits = overflow == 0 && value >= 0 && value <= std::numeric_limits<std::uint32_t>::max();
  return fits ? static_cast<std::uint32_t>(value) : std::numeric_limits<std::uint32_t>::max();
}

/// The frame of a tuple, whose data stay as long as the tuple; throws TypeError for anything else.
inline Frame frame_of(PyObject* frame) {
  if (!PyTuple_Check(frame) || PyTuple_GET_SIZE(frame) != 3 || !PyLong_Check(PyTuple_GET_ITEM(frame, 0)) ||
      !PyLong_Check(PyTuple_GET_ITEM(frame, 1)) || !PyBytes_Check(PyTuple_GET_ITEM(frame, 2))) {
    throw py::type_error("a frame must be a tuple of identifier, kind and bytes");
  }
  PyObject* data = PyTuple_GET_ITEM(frame, 2);
  return {number_of(PyTuple_GET_ITEM(frame, 0)), number_of(PyTuple_GET_ITEM(frame, 1)),
          reinterpret_cast<const std::uint8_t*>(PyBytes_AS_STRING(data)),
          static_cast<std::size_t>(PyBytes_GET_SIZE(data))};
}

/// A frame as a tuple.
inline py::tuple tuple_of(const Frame& frame) {
  return py::make_tuple(frame.identifier, frame.kind,
                        py::bytes(reinterpret_cast<const char*>(frame.data), frame.length));
}

}  // namespace posfet::protocol
