// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Constants, and what the standard library lacks for numbers, of which some may be unknown (NaN).
#pragma once

#include <cmath>
#include <limits>
#include <numeric>

namespace posfet {

constexpr double kPi = 3.141592653589793;
constexpr double kTurn = 2.0 * kPi;  ///< [rad]
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

inline double square(double value) { return value * value; }

template <typename Values>
double sum(const Values& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

/// The greater number; NaN if one is NaN.
inline double maximum(double one, double other) { return one >= other || std::isnan(one) ? one : other; }

/// The smaller number; NaN if one is NaN.
inline double minimum(double one, double other) { return one <= other || std::isnan(one) ? one : other; }

}  // namespace posfet
