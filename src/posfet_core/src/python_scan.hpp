// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// A scan of posfet_model/sensor/scan.py as the path takes it.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstdint>
#include <limits>

#include "posfet_core/scan.hpp"
#include "python_arrays.hpp"

namespace posfet {

namespace py = pybind11;

/// An attribute of an object by an interned name.
inline py::object attribute(const py::handle& object, PyObject* name) {
  PyObject* value = PyObject_GetAttr(object.ptr(), name);
  if (value == nullptr) {
    throw py::error_already_set();
  }
  return py::reinterpret_steal<py::object>(value);
}

/// A Python integer, the nearest one that fits where it is out of range.
inline std::int64_t signed_of(const py::object& number) {
  int overflow = 0;
  const long long value = PyLong_AsLongLongAndOverflow(number.ptr(), &overflow);
  if (overflow != 0) {
    return overflow > 0 ? std::numeric_limits<std::int64_t>::max() : std::numeric_limits<std::int64_t>::min();
  }
  if (value == -1 && PyErr_Occurred() != nullptr) {
    throw py::error_already_set();
  }
  return value;
}

/// The same without a sign.
inline std::uint64_t unsigned_of(const py::object& number) {
  const std::int64_t value = signed_of(number);
  if (value < std::numeric_limits<std::int64_t>::max()) {
    return value < 0 ? 0 : static_cast<std::uint64_t>(value);
  }
  const unsigned long long large = PyLong_AsUnsignedLongLong(number.ptr());
  if (PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    return std::numeric_limits<std::uint64_t>::max();
  }
  return large;
}

/// The attributes of a scan, and the arrays that it refers to.
class PythonScan {
public:
  explicit PythonScan(const py::handle& object) {
    static const Names names;
    counts_ = Counts::ensure(attribute(object, names.counts));
    temperatures_ = Temperatures::ensure(attribute(object, names.temperatures));
    if (!counts_ || !temperatures_) {
      throw py::type_error("counts must be an array of uint16, temperatures one of numbers");
    }
    scan_.stamp = signed_of(attribute(object, names.stamp));
    scan_.layout = unsigned_of(attribute(object, names.layout_id));
    scan_.sequence = unsigned_of(attribute(object, names.sequence));
    scan_.device_time = signed_of(attribute(object, names.device_time));
    scan_.status = static_cast<std::uint32_t>(unsigned_of(attribute(object, names.status)));
    scan_.counts = counts_.data();
    scan_.taxels = counts_.ndim() == 1 ? static_cast<std::size_t>(counts_.size()) : 0;
    scan_.temperatures = temperatures_.data();
    scan_.sensors = static_cast<std::size_t>(temperatures_.size());
  }

  const Scan& scan() const { return scan_; }

private:
  using Temperatures = py::array_t<float, py::array::c_style | py::array::forcecast>;

  /// Names of the attributes, made once.
  struct Names {
    PyObject* stamp = PyUnicode_InternFromString("stamp");
    PyObject* layout_id = PyUnicode_InternFromString("layout_id");
    PyObject* sequence = PyUnicode_InternFromString("sequence");
    PyObject* device_time = PyUnicode_InternFromString("device_time");
    PyObject* counts = PyUnicode_InternFromString("counts");
    PyObject* temperatures = PyUnicode_InternFromString("temperatures");
    PyObject* status = PyUnicode_InternFromString("status");
  };

  Counts counts_;
  Temperatures temperatures_;
  Scan scan_;
};

}  // namespace posfet
