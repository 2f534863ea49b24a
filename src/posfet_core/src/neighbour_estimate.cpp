// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/neighbour_estimate.hpp"

#include <array>
#include <cmath>
#include <limits>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Forces of a square by their position from the taxel that it predicts [N]; NaN: unknown, or outside of the array.
struct Square {
  double horizontal;
  double vertical;
  double diagonal;
  bool inside;  ///< Whether it lies on the array.

  double prediction() const { return horizontal * vertical / diagonal; }
  double smallest() const { return minimum(minimum(horizontal, vertical), diagonal); }
};

/// The four squares of a taxel, by their neighbours in `Grid::kOffsets`.
constexpr std::array<std::array<std::size_t, 3>, 4> kSquares{{{3, 1, 0}, {4, 1, 2}, {3, 6, 5}, {4, 6, 7}}};

/// The squares of a taxel; forces below `floor` count as this one.
std::array<Square, 4> squares(const Grid& grid, const double* force, const bool* unknown, Taxel taxel, double floor) {
  const auto& around = grid.neighbours(taxel);
  const auto known = [&](Taxel other) {
    const bool usable = other != Grid::kOutside && (unknown == nullptr || !unknown[other]);
    return usable ? maximum(floor, force[other]) : kUnknown;  // in this order: never -0.0
  };
  std::array<Square, 4> found{};
  for (std::size_t index = 0; index < found.size(); ++index) {
    const auto& [horizontal, vertical, diagonal] = kSquares[index];
    found[index] = {known(around[horizontal]), known(around[vertical]), known(around[diagonal]),
                    around[diagonal] != Grid::kOutside};
  }
  return found;
}

}  // namespace

double neighbour_interpolation(const Grid& grid, const double* force, const bool* unknown, Taxel taxel, double floor) {
  double weighted = 0.0;
  double total = 0.0;
  double largest = kUnknown;
  for (const Square& square : squares(grid, force, unknown, taxel, floor)) {
    const double logarithm = std::log(square.prediction());
    if (std::isfinite(logarithm)) {
      weighted += square.smallest() * logarithm;
      total += square.smallest();
    }
    largest = std::fmax(largest, maximum(square.horizontal, square.vertical));
  }
  return largest <= floor ? 0.0 : std::exp(weighted / total);
}

double neighbour_lower_bound(const Grid& grid, const double* force, const bool* unknown, Taxel taxel, double floor) {
  double least = std::numeric_limits<double>::infinity();
  bool any = false;
  for (const Square& square : squares(grid, force, unknown, taxel, 0.0)) {
    if (!square.inside) {
      continue;
    }
    const bool informative = square.smallest() >= floor;
    if (!informative) {
      return 0.0;
    }
    any = true;
    least = minimum(least, square.prediction());
  }
  return any ? least : 0.0;
}

double largest_neighbour(const Grid& grid, const double* values, Taxel taxel) {
  double largest = -std::numeric_limits<double>::infinity();
  for (const Taxel other : grid.neighbours(taxel)) {
    largest = other == Grid::kOutside ? largest : maximum(largest, values[other]);
  }
  return largest;
}

}  // namespace posfet
