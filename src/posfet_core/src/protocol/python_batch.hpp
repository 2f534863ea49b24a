// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Batches of Python's frames, and Python's Scan.
#pragma once

#include <pybind11/pybind11.h>

#include <cstddef>

#include "python_integers.hpp"

namespace posfet::protocol {

namespace py = pybind11;

/// Python's Scan as it is filled in.
class ScanFields {
public:
  /// Set all but counts and temperatures, from a CompleteScan or a MappedScan.
  template <typename Complete>
  static void set(const py::object& scan, const Complete& found) {
    static const ScanFields names;
    assign(scan, names.stamp_, py::cast(found.stamp));
    assign(scan, names.sequence_, py::cast(found.sequence));
    assign(scan, names.device_time_, py::cast(found.device_time));
    assign(scan, names.status_, py::int_(found.status));
    assign(scan, names.frames_lost_, py::int_(found.frames_lost));
    assign(scan, names.stamp_uncertainty_, py::float_(found.stamp_uncertainty));
  }

private:
  static PyObject* name(const char* text) { return PyUnicode_InternFromString(text); }

  static void assign(const py::object& scan, PyObject* name, const py::object& value) {
    if (PyObject_SetAttr(scan.ptr(), name, value.ptr()) != 0) {
      throw py::error_already_set();
    }
  }

  PyObject* stamp_ = name("stamp");
  PyObject* sequence_ = name("sequence");
  PyObject* device_time_ = name("device_time");
  PyObject* status_ = name("status");
  PyObject* frames_lost_ = name("frames_lost");
  PyObject* stamp_uncertainty_ = name("stamp_uncertainty");
};

/// Frames of a batch, and which is next.
class Batch {
public:
  explicit Batch(const py::object& frames)
      : frames_(py::reinterpret_steal<py::object>(PySequence_Fast(frames.ptr(), "frames must be a sequence"))) {
    if (!frames_) {
      throw py::error_already_set();
    }
  }

  std::size_t size() const { return static_cast<std::size_t>(PySequence_Fast_GET_SIZE(frames_.ptr())); }

  /// The next frame, borrowed; null after the last one.
  PyObject* next() {
    return next_ < PySequence_Fast_GET_SIZE(frames_.ptr()) ? PySequence_Fast_GET_ITEM(frames_.ptr(), next_++) : nullptr;
  }

  bool ended = false;  ///< Nothing is left to be released, and the decoder was told that the batch has ended.

private:
  py::object frames_;
  py::ssize_t next_ = 0;
};

}  // namespace posfet::protocol
