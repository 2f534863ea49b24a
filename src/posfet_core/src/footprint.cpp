// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/footprint.hpp"

#include <algorithm>
#include <utility>

namespace posfet {

namespace {

constexpr Taxel kNone = -1;
constexpr Taxel kSeveral = -2;

/// Give a taxel to a region, or to none when it belongs to another region's ring already.
void claim(Taxel& owner, Taxel region) {
  if (owner == kNone) {
    owner = region;
  } else if (owner != region) {
    owner = kSeveral;
  }
}

/// The only region that contains each taxel or borders on it; `kNone` or `kSeveral` where that is not one.
Vector<Taxel> owners(const Grid& grid, const Vector<Taxels>& regions) {
  Vector<Taxel> owner(static_cast<std::size_t>(grid.taxels()), kNone);
  for (std::size_t number = 0; number < regions.size(); ++number) {
    for (const Taxel taxel : regions[number]) {
      claim(owner[static_cast<std::size_t>(taxel)], static_cast<Taxel>(number));
      for (const Taxel beside : grid.neighbours(taxel)) {
        if (beside != Grid::kOutside) {
          claim(owner[static_cast<std::size_t>(beside)], static_cast<Taxel>(number));
        }
      }
    }
  }
  return owner;
}

/// Move what is connected with a taxel from the mask `left` into a component.
Taxels component_from(const Grid& grid, Mask& left, Taxel first) {
  Taxels found{first};
  left[static_cast<std::size_t>(first)] = 0;
  for (std::size_t next = 0; next < found.size(); ++next) {
    for (const Taxel beside : grid.neighbours(found[next])) {
      if (beside != Grid::kOutside && left[static_cast<std::size_t>(beside)]) {
        left[static_cast<std::size_t>(beside)] = 0;
        found.push_back(beside);
      }
    }
  }
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

Vector<Taxels> connected_components(const Grid& grid, const Mask& mask) {
  Vector<Taxels> found;
  Mask left = mask;
  for (Taxel taxel = 0; taxel < grid.taxels(); ++taxel) {
    if (left[static_cast<std::size_t>(taxel)]) {
      found.push_back(component_from(grid, left, taxel));
    }
  }
  return found;
}

Vector<Footprint> footprints(const Grid& grid, const Mask& mask) {
  Vector<Taxels> regions = connected_components(grid, mask);
  Vector<Footprint> found(regions.size());
  if (regions.empty()) {
    return found;
  }
  const Vector<Taxel> owner = owners(grid, regions);
  for (Taxel taxel = 0; taxel < grid.taxels(); ++taxel) {
    const Taxel number = owner[static_cast<std::size_t>(taxel)];
    if (number >= 0) {
      found[static_cast<std::size_t>(number)].members.push_back(taxel);
    }
  }
  for (std::size_t number = 0; number < regions.size(); ++number) {
    Footprint& footprint = found[number];
    footprint.region = std::move(regions[number]);
    footprint.at_edge = std::any_of(footprint.members.begin(), footprint.members.end(),
                                    [&](Taxel taxel) { return grid.at_edge(taxel); });
  }
  return found;
}

Outline outline(const Grid& grid, Taxels taxels) {
  Point sum;
  for (const Taxel taxel : taxels) {
    sum.x += grid.position(taxel).x;
    sum.y += grid.position(taxel).y;
  }
  const auto count = static_cast<double>(taxels.size());
  const double cell = grid.layout().pitch_x * grid.layout().pitch_y;
  return {std::move(taxels), {sum.x / count, sum.y / count}, count * cell};
}

}  // namespace posfet
