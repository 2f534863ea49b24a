// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Arguments of the estimator of static force and of its parts, from Python.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <vector>

#include "posfet_core/estimation/error_states.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// The values of `ErrorPriors` of Python.
ErrorPriors priors_from(const pybind11::object& priors);

/// Values as a new array.
template <typename Numbers>
pybind11::array_t<double> array_of(const Numbers& values) {
  return pybind11::array_t<double>(static_cast<pybind11::ssize_t>(values.size()), values.data());
}

/// The same with so many columns.
template <typename Numbers>
pybind11::array_t<double> array_of(const Numbers& values, pybind11::ssize_t columns) {
  return array_of(values).reshape({static_cast<pybind11::ssize_t>(values.size()) / columns, columns});
}

/// The taxels of each contact. Throws IndexError where one is outside of the array.
std::vector<Taxels> contacts_from(const pybind11::sequence& contacts, Taxel taxels);

/// The same as the estimator takes them, which does not own them.
Vector<const Taxels*> pointers_to(const std::vector<Taxels>& contacts);

}  // namespace posfet
