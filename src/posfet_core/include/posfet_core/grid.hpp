// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Taxels of an array by index, row by row: their places, neighbours, and sets of them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "posfet_core/recycled.hpp"

namespace posfet {

/// Index of a taxel, or a number of taxels.
using Taxel = std::ptrdiff_t;

/// Set of taxels: their indices, ascending.
using Taxels = Vector<Taxel>;

/// One flag for each taxel, 0 or 1.
using Mask = Vector<std::uint8_t>;

/// Position or vector (x, y) [m] in the frame of the array.
struct Point {
  double x = 0.0;
  double y = 0.0;
};

/// Size of an array.
struct Layout {
  Taxel rows;
  Taxel cols;
  double pitch_x;     ///< Distance of neighbours in a row [m].
  double pitch_y;     ///< Distance of neighbours in a column [m].
  double taxel_area;  ///< Area of a taxel [m2], at most that of its cell.
};

/// Places and neighbours of the taxels of one array; does not change.
class Grid {
public:
  /// Offsets (rows, columns) to the eight neighbours, row by row.
  static constexpr std::array<std::array<int, 2>, 8> kOffsets{
      {{-1, -1}, {-1, 0}, {-1, 1}, {0, -1}, {0, 1}, {1, -1}, {1, 0}, {1, 1}}};

  /// Places in `kOffsets` of the neighbours that share an edge with the taxel: above, left, right, below.
  static constexpr std::array<std::size_t, 4> kEdges{1, 3, 4, 6};

  /// Index of a neighbour that would lie outside of the array.
  static constexpr Taxel kOutside = -1;

  /// Throws std::invalid_argument where the array has no taxel, or a length is not positive.
  explicit Grid(const Layout& layout);

  const Layout& layout() const { return layout_; }
  Taxel taxels() const { return layout_.rows * layout_.cols; }
  Taxel row(Taxel taxel) const { return taxel / layout_.cols; }
  Taxel col(Taxel taxel) const { return taxel % layout_.cols; }
  double largest_pitch() const { return layout_.pitch_x > layout_.pitch_y ? layout_.pitch_x : layout_.pitch_y; }

  /// Centre of a taxel [m].
  const Point& position(Taxel taxel) const { return positions_[static_cast<std::size_t>(taxel)]; }

  /// Neighbours of a taxel in the order of `kOffsets`.
  const std::array<Taxel, 8>& neighbours(Taxel taxel) const { return neighbours_[static_cast<std::size_t>(taxel)]; }

  /// Whether a taxel lies in the outermost rows or columns.
  bool at_edge(Taxel taxel) const;

private:
  Layout layout_;
  std::vector<Point> positions_;
  std::vector<std::array<Taxel, 8>> neighbours_;
};

/// Whether two sets have a taxel in common.
bool intersect(const Taxels& some, const Taxels& others);

/// Taxels of a mask dilated by `distance` along rows, columns and diagonals.
Mask dilated(const Grid& grid, const Mask& mask, Taxel distance);

}  // namespace posfet
