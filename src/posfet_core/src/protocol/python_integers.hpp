// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Python's integers and `Wide`.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>
#include <limits>

#include "posfet_core/protocol/integers.hpp"

namespace pybind11::detail {

/// An integer beyond 64 bits counts as the greatest or least of them: no clock has such times.
template <>
class type_caster<posfet::protocol::Wide> {
public:
  PYBIND11_TYPE_CASTER(posfet::protocol::Wide, const_name("int"));

  bool load(handle source, bool /*convert*/) {
    if (!PyIndex_Check(source.ptr())) {
      return false;
    }
    const auto integer = reinterpret_steal<object>(PyNumber_Index(source.ptr()));
    int overflow = 0;
    const long long number = PyLong_AsLongLongAndOverflow(integer.ptr(), &overflow);
    value = number;
    if (overflow != 0) {
      value = overflow > 0 ? std::numeric_limits<long long>::max() : std::numeric_limits<long long>::min();
    }
    return true;
  }

  static handle cast(posfet::protocol::Wide number, return_value_policy /*policy*/, handle /*parent*/) {
    const auto low = static_cast<std::int64_t>(number);
    if (number == low) {
      return PyLong_FromLongLong(low);
    }
    const auto rest = static_cast<std::uint64_t>(number);
    constexpr posfet::protocol::Wide word = posfet::protocol::Wide{std::numeric_limits<std::uint64_t>::max()} + 1;
    const int_ words(static_cast<std::int64_t>((number - rest) / word));
    return ((words << int_(64)) | int_(rest)).release();
  }
};

}  // namespace pybind11::detail
