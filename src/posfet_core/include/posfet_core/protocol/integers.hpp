// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Integers that no input overflows, and how floating-point numbers become integers.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

namespace posfet::protocol {

/// Times [us] and [ns]: neither a reading nor a sum of readings, of whatever board, leaves its range.
__extension__ typedef __int128 Wide;  // NOLINT(modernize-use-using): the mark of the extension is allowed only here

/// A time that never comes [ns], and whose negative is before all others: beyond any of 64 bits.
constexpr Wide kNever = Wide{std::numeric_limits<std::int64_t>::max()} + 1;

/// Nanoseconds of a second.
constexpr double kNanoseconds = 1e9;

/// Magnitude below which a number is converted; no time comes near it.
constexpr double kLargest = 1e33;

/// The nearest integer, ties to even; 0 for what is no number, or too large to be a time.
inline Wide rounded(double number) {
  return std::abs(number) < kLargest ? static_cast<Wide>(std::nearbyint(number)) : Wide{0};
}

/// The integer next to it towards 0; 0 as for `rounded`.
inline Wide truncated(double number) { return std::abs(number) < kLargest ? static_cast<Wide>(number) : Wide{0}; }

/// The nearest floating-point number.
inline double real(Wide number) { return static_cast<double>(number); }

/// Whether an integer is greater than a number, exactly; false if that is NaN.
inline bool exceeds(Wide integer, double number) {
  if (std::abs(number) < kLargest) {
    return integer > static_cast<Wide>(std::floor(number));
  }
  return number < 0.0;
}

}  // namespace posfet::protocol
