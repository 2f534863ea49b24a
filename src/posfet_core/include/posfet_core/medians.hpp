// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Medians of few values, which are put in another order; unknown ones (NaN) are the greatest.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace posfet {

/// Put the value of a rank at its place: none before it is greater, none behind it is less.
template <typename Numbers>
double place_rank(Numbers& values, std::size_t rank) {
  const auto place = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), place, values.end(),
                   [](double one, double other) { return one < other || (std::isnan(other) && !std::isnan(one)); });
  return *place;
}

/// Median of at least one value.
template <typename Numbers>
double median(Numbers& values) {
  const std::size_t half = values.size() / 2;
  const double upper = place_rank(values, half);
  if (values.size() % 2 == 1) {
    return upper;
  }
  return 0.5 * (*std::max_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(half)) + upper);
}

/// Upper median of values; 0 of none.
template <typename Numbers>
double upper_median(Numbers& values) {
  return values.empty() ? 0.0 : place_rank(values, values.size() / 2);
}

}  // namespace posfet
