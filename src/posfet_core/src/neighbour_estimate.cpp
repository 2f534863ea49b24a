// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/neighbour_estimate.hpp"

#include <array>
#include <cmath>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// A square by its horizontal, vertical and diagonal neighbour, as indices of `Grid::kOffsets`.
constexpr std::array<std::array<std::size_t, 3>, 4> kSquares{{{3, 1, 0}, {4, 1, 2}, {3, 6, 5}, {4, 6, 7}}};

}  // namespace

double least_neighbour_estimate(const Grid& grid, const double* force, Taxel taxel) {
  const auto& around = grid.neighbours(taxel);
  double least = HUGE_VAL;
  bool inside = false;
  for (const auto& [horizontal, vertical, diagonal] : kSquares) {
    if (around[diagonal] == Grid::kOutside) {
      continue;
    }
    inside = true;
    const double beside = maximum(force[around[horizontal]], 0.0);
    const double above = maximum(force[around[vertical]], 0.0);
    const double opposite = maximum(force[around[diagonal]], 0.0);
    if (std::isnan(beside) || std::isnan(above) || std::isnan(opposite)) {
      return 0.0;
    }
    least = minimum(least, beside * above / opposite);
  }
  return inside ? least : 0.0;
}

}  // namespace posfet
