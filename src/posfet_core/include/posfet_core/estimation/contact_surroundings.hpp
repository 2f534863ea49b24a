// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the taxels beside a contact feel of it: the elastomer skin spreads every force.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// Weight of the force of a taxel at a corner against that of one at an edge, for what a taxel beside them feels [1],
/// assumed.
constexpr double kDiagonal = 0.3;

/// Neighbours of the taxels of an array, and the greatest force that a taxel beside a contact can feel.
///
/// A Gaussian spreads every point load, and a contact that is pressed in one piece is log-concave along each axis, as
/// is the result: each force is at most that of a geometric decline from the two before it, f1*f1/f2. Under the shipped
/// fingertips it is a tenth of that, within a factor of two; the greatest force of the array in place of f2 says half
/// as much.
class ContactSurroundings {
public:
  explicit ContactSurroundings(Grid grid) : grid_(std::move(grid)) {}

  const Grid& grid() const { return grid_; }
  std::size_t taxels() const { return static_cast<std::size_t>(grid_.taxels()); }

  /// Find a mask of taxels with their neighbours; another one.
  void dilate(const TaxelFlags& mask, TaxelFlags& dilated) const;

  /// Set the unknown ones (NaN) among the forces [N], >= 0, to the greatest that each can be beside the others; `least`
  /// as for `geometric_decline`.
  void complete(std::vector<double>& force, double least) const;

  /// Find the greatest force of each taxel's neighbours [N]; those at a corner count less. Forces are >= 0.
  void greatest_neighbour(const std::vector<double>& force, std::vector<double>& greatest) const;

  /// Find the force of each taxel if forces declined geometrically towards it [N]. Forces are >= 0, NaN where unknown.
  /// Of the lines along the axes of the array that end at the taxel, the one with the greatest force counts. Where the
  /// second taxel of a line is unknown or outside the array, the greatest force of the array stands in for it, at least
  /// `least`.
  void geometric_decline(const std::vector<double>& force, double least, std::vector<double>& decline) const;

private:
  Grid grid_;
};

}  // namespace posfet
