// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// NumPy arrays as arguments: one value for each taxel.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

namespace py = pybind11;

/// Values of any type that NumPy converts; a copy only where it must.
using Values = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// Values that are kept by reference: no copy.
using KeptValues = py::array_t<double, py::array::c_style>;

/// Counts of an ADC: of no type that could hold a value beyond 16 bits, which would change by the conversion.
using Counts = py::array_t<std::uint16_t, py::array::c_style>;

/// Flags of all taxels.
using Tested = py::array_t<bool, py::array::c_style | py::array::forcecast>;

/// Indices of taxels.
using Indices = py::array_t<Taxel, py::array::c_style | py::array::forcecast>;

/// Flags, or none.
using Flags = std::optional<py::array_t<bool, py::array::c_style | py::array::forcecast>>;

/// Throws ValueError (std::invalid_argument) where an array has not one row for each taxel.
inline void require_taxels(const py::array& array, Taxel taxels, const char* name) {
  if (array.ndim() == 0 || array.shape(0) != taxels) {
    throw std::invalid_argument(std::string(name) + " must have one value for each of " + std::to_string(taxels) +
                                " taxels");
  }
}

/// The values of all taxels.
inline const double* values_of(const py::array_t<double>& array, Taxel taxels, const char* name) {
  require_taxels(array, taxels, name);
  return array.data();
}

/// Throws ValueError (std::invalid_argument) where there is no taxel.
inline Taxel at_least_one(py::ssize_t taxels) {
  if (taxels < 1) {
    throw std::invalid_argument("there must be at least one taxel");
  }
  return static_cast<Taxel>(taxels);
}

/// The flags of all taxels; null for none.
inline const bool* flags_of(const Flags& flags, Taxel taxels, const char* name) {
  if (!flags) {
    return nullptr;
  }
  require_taxels(*flags, taxels, name);
  return flags->data();
}

/// A set of taxels as a new array.
inline py::array_t<Taxel> array_of(const Taxels& taxels) {
  return py::array_t<Taxel>(static_cast<py::ssize_t>(taxels.size()), taxels.data());
}

/// A read-only view of an object's own values.
inline py::array view_of(const std::vector<double>& values, const py::object& owner) {
  py::array view(py::dtype::of<double>(), {static_cast<py::ssize_t>(values.size())}, {}, values.data(), owner);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

/// A writable view of the elements of an object.
template <typename Element>
py::array view_of(Element* elements, std::vector<py::ssize_t> shape, const py::object& owner) {
  return py::array(py::dtype::of<Element>(), std::move(shape), {}, elements, owner);
}

inline py::array view_of(TaxelFlags& flags, const py::object& owner) {
  return view_of(flags.data(), {static_cast<py::ssize_t>(flags.size())}, owner);
}

/// The values of an array as a vector.
inline std::vector<double> vector_of(const Values& values) { return {values.data(), values.data() + values.size()}; }

/// Throws ValueError where a value is not a positive number.
inline double positive(double value, const char* name) {
  const bool fits = value > 0.0 && std::isfinite(value);
  if (!fits) {
    throw std::invalid_argument(std::string(name) + " must be positive");
  }
  return value;
}

/// A mask as a new array.
inline py::array_t<bool> array_of(const Mask& mask) {
  py::array_t<bool> flags(static_cast<py::ssize_t>(mask.size()));
  std::copy(mask.begin(), mask.end(), flags.mutable_data());
  return flags;
}

/// Flags as a new array.
inline py::array_t<bool> array_of(const TaxelFlags& flags) {
  return py::array_t<bool>(static_cast<py::ssize_t>(flags.size()), flags.data());
}

/// The mask of an array of flags.
inline Mask mask_of(const py::array_t<bool, py::array::c_style | py::array::forcecast>& flags, Taxel taxels,
                    const char* name) {
  require_taxels(flags, taxels, name);
  return Mask(flags.data(), flags.data() + taxels);
}

}  // namespace posfet
