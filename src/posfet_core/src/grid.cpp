// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/grid.hpp"

#include <algorithm>
#include <stdexcept>

namespace posfet {

namespace {

Taxel neighbour(const Layout& layout, Taxel row, Taxel col) {
  const bool inside = row >= 0 && row < layout.rows && col >= 0 && col < layout.cols;
  return inside ? row * layout.cols + col : Grid::kOutside;
}

/// Set the flags up to `distance` away from every set one along a line of `count` flags that are `stride` apart.
void dilate_line(const Mask& from, Mask& into, Taxel begin, Taxel count, Taxel stride, Taxel distance) {
  Taxel set_until = -1;
  for (Taxel ahead = 0; ahead < count + distance; ++ahead) {
    if (ahead < count && from[static_cast<std::size_t>(begin + ahead * stride)]) {
      set_until = ahead + distance;
    }
    const Taxel here = ahead - distance;
    if (here >= 0 && here <= set_until) {
      into[static_cast<std::size_t>(begin + here * stride)] = 1;
    }
  }
}

}  // namespace

Grid::Grid(const Layout& layout) : layout_(layout) {
  if (layout.rows < 1 || layout.cols < 1) {
    throw std::invalid_argument("rows and cols must be at least 1");
  }
  const auto positive = [](double length) { return length > 0.0; };
  if (!positive(layout.pitch_x) || !positive(layout.pitch_y) || !positive(layout.taxel_area)) {
    throw std::invalid_argument("pitch_x, pitch_y and taxel_area must be positive");
  }
  positions_.reserve(static_cast<std::size_t>(taxels()));
  neighbours_.reserve(static_cast<std::size_t>(taxels()));
  for (Taxel row = 0; row < layout.rows; ++row) {
    for (Taxel col = 0; col < layout.cols; ++col) {
      positions_.push_back({(static_cast<double>(col) - static_cast<double>(layout.cols - 1) / 2) * layout.pitch_x,
                            (static_cast<double>(row) - static_cast<double>(layout.rows - 1) / 2) * layout.pitch_y});
      auto& around = neighbours_.emplace_back();
      std::transform(kOffsets.begin(), kOffsets.end(), around.begin(), [&](const std::array<int, 2>& offset) {
        return neighbour(layout, row + offset[0], col + offset[1]);
      });
    }
  }
}

bool Grid::at_edge(Taxel taxel) const {
  const Taxel r = row(taxel);
  const Taxel c = col(taxel);
  return r == 0 || r == layout_.rows - 1 || c == 0 || c == layout_.cols - 1;
}

bool intersect(const Taxels& some, const Taxels& others) {
  auto one = some.begin();
  auto other = others.begin();
  while (one != some.end() && other != others.end()) {
    if (*one == *other) {
      return true;
    }
    *one < *other ? ++one : ++other;
  }
  return false;
}

Mask dilated(const Grid& grid, const Mask& mask, Taxel distance) {
  const Taxel rows = grid.layout().rows;
  const Taxel cols = grid.layout().cols;
  Mask along_rows(mask.size());
  Mask both(mask.size());
  for (Taxel row = 0; row < rows; ++row) {
    dilate_line(mask, along_rows, row * cols, cols, 1, distance);
  }
  for (Taxel col = 0; col < cols; ++col) {
    dilate_line(along_rows, both, col, rows, cols, distance);
  }
  return both;
}

}  // namespace posfet
