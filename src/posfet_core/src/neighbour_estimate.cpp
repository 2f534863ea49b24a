// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/neighbour_estimate.hpp"

#include <algorithm>
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
  double turn;  ///< Sign of its twist: 1 where the diagonal has the same sign along rows and columns, -1 elsewhere.
  bool inside;  ///< Whether it lies on the array.

  double prediction() const { return horizontal * vertical / diagonal; }
  double smallest() const { return minimum(minimum(horizontal, vertical), diagonal); }

  /// Variance of the logarithm of its prediction, weighted by its smallest force, after an error of 1 N in each force.
  double weighted_variance() const {
    const double least = smallest();
    return square(least / horizontal) + square(least / vertical) + square(least / diagonal);
  }
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
    const double turn = index == 0 || index == 3 ? 1.0 : -1.0;
    found[index] = {known(around[horizontal]), known(around[vertical]), known(around[diagonal]), turn,
                    around[diagonal] != Grid::kOutside};
  }
  return found;
}

/// Twist of the logarithm of the forces, as the squares next to a taxel's show it: mean weighted by the square of the
/// smallest force in each.
double twist_around(const Grid& grid, const double* force, const bool* unknown, Taxel taxel, double floor) {
  const Taxel row = grid.row(taxel);
  const Taxel col = grid.col(taxel);
  const Taxel cols = grid.layout().cols;
  double weighted = 0.0;
  double total = square(kTwistForce * floor);
  for (Taxel top = std::max<Taxel>(row - 2, 0); top <= std::min(row + 1, grid.layout().rows - 2); ++top) {
    for (Taxel left = std::max<Taxel>(col - 2, 0); left <= std::min(col + 1, cols - 2); ++left) {
      const bool of_taxel = top <= row && row <= top + 1 && left <= col && col <= left + 1;
      const Taxel first = top * cols + left;
      const std::array<Taxel, 4> corners{first, first + 1, first + cols, first + cols + 1};
      const bool known =
          std::none_of(corners.begin(), corners.end(), [&](Taxel each) { return unknown && unknown[each]; });
      if (of_taxel || !known) {
        continue;
      }
      std::array<double, 4> forces{};
      std::transform(corners.begin(), corners.end(), forces.begin(),
                     [&](Taxel each) { return maximum(floor, force[each]); });
      const double logarithm = std::log(forces[0] * forces[3] / (forces[1] * forces[2]));
      const double least = *std::min_element(forces.begin(), forces.end());
      if (std::isfinite(logarithm) && least > floor) {
        const double weight = square(least);
        weighted += weight * logarithm;
        total += weight;
      }
    }
  }
  return total > 0.0 ? weighted / total : 0.0;
}

}  // namespace

NeighbourEstimate neighbour_interpolation(const Grid& grid, const double* force, const bool* unknown, Taxel taxel,
                                          const InterpolationLimits& limits) {
  double weighted = 0.0;
  double weighted_square = 0.0;
  double total = 0.0;
  double variance = 0.0;
  double largest = kUnknown;
  double most = kUnknown;
  const double twist = twist_around(grid, force, unknown, taxel, limits.floor);
  for (const Square& each : squares(grid, force, unknown, taxel, limits.floor)) {
    const double logarithm = std::log(each.prediction()) + each.turn * twist;
    if (std::isfinite(logarithm)) {
      weighted += each.smallest() * logarithm;
      weighted_square += each.smallest() * square(logarithm);
      total += each.smallest();
      variance += each.weighted_variance();
    }
    largest = std::fmax(largest, maximum(each.horizontal, each.vertical));
    most = std::fmax(most, std::fmax(limits.most_x * each.horizontal, limits.most_y * each.vertical));
  }
  if (largest <= limits.floor) {
    return {0.0, 0.0};
  }
  const double mean = weighted / total;
  const double found = std::exp(mean);
  if (found > most) {
    return {most, most};
  }
  const double disagreement = std::max(weighted_square / total - square(mean), 0.0);
  const double relative = square(kInterpolationUncertainty) + disagreement + variance * square(limits.floor / total);
  return {found, found * std::sqrt(relative)};
}

double neighbour_lower_bound(const Grid& grid, const double* force, const bool* unknown, Taxel taxel,
                             const double* floor) {
  const auto& around = grid.neighbours(taxel);
  double least = std::numeric_limits<double>::infinity();
  bool any = false;
  const std::array<Square, 4> found = squares(grid, force, unknown, taxel, 0.0);
  for (std::size_t index = 0; index < found.size(); ++index) {
    const Square& each = found[index];
    if (!each.inside) {
      continue;
    }
    const auto& [horizontal, vertical, diagonal] = kSquares[index];
    const auto least_of = [&](std::size_t place) { return floor == nullptr ? 0.0 : floor[around[place]]; };
    const bool informative = each.horizontal >= least_of(horizontal) && each.vertical >= least_of(vertical) &&
                             each.diagonal >= least_of(diagonal);
    if (!informative) {
      return 0.0;
    }
    any = true;
    least = minimum(least, each.prediction());
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
