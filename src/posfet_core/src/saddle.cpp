// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/saddle.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <utility>

#include "posfet_core/neighbour_estimate.hpp"

namespace posfet {

/// Watershed of one region: taxels are flooded from the highest one down, and basins without a deep enough saddle
/// between their peaks are joined. Taxels are counted by their place in the region.
class SaddleFinder::Watershed {
public:
  Watershed(const Grid& grid, const Taxels& region, const double* force, const bool* interpolated, Limits limits)
      : grid_(grid), region_(region), force_(force), limits_(limits), basin_(region.size(), kDry) {
    values_.reserve(region.size());
    for (const Taxel taxel : region) {
      values_.push_back(interpolated != nullptr && interpolated[taxel] ? highest_known_neighbour(taxel, interpolated)
                                                                       : force[taxel]);
    }
  }

  /// Peaks that are left, as taxels, ascending.
  Taxels peaks() {
    Vector<std::size_t> order(region_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    // The first of equal ones first.
    std::sort(order.begin(), order.end(), [&](std::size_t one, std::size_t other) {
      const bool higher = values_[one] > values_[other] || (std::isnan(values_[other]) && !std::isnan(values_[one]));
      const bool lower = values_[one] < values_[other] || (std::isnan(values_[one]) && !std::isnan(values_[other]));
      return higher || (!lower && one < other);
    });
    for (const std::size_t place : order) {
      flood(place);
    }
    Taxels found;
    for (std::size_t place = 0; place < region_.size(); ++place) {
      if (basin_[place] == place) {
        found.push_back(region_[place]);
      }
    }
    return found;
  }

private:
  static constexpr std::size_t kDry = static_cast<std::size_t>(-1);

  /// Highest saddle between a taxel and a basin beside it [N].
  struct Saddle {
    std::size_t peak;
    double height;
  };

  /// Place of a taxel in the region; its size for a taxel that is not in it.
  std::size_t place(Taxel taxel) const {
    const auto at = std::lower_bound(region_.begin(), region_.end(), taxel);
    const bool inside = at != region_.end() && *at == taxel;
    return inside ? static_cast<std::size_t>(at - region_.begin()) : region_.size();
  }

  double highest_known_neighbour(Taxel taxel, const bool* interpolated) const {
    double highest = 0.0;
    bool any = false;
    for (const Taxel beside : grid_.neighbours(taxel)) {
      if (beside != Grid::kOutside && place(beside) < region_.size() && !interpolated[beside]) {
        highest = any ? std::max(highest, force_[beside]) : force_[beside];
        any = true;
      }
    }
    return highest;
  }

  void flood(std::size_t here) {
    Vector<Saddle> saddles = saddles_beside(here);
    basin_[here] = here;
    const auto higher = [](const Saddle& one, const Saddle& other) { return one.height > other.height; };
    for (auto at = saddles.begin(); at != saddles.end(); ++at) {  // stable, and without memory
      std::rotate(std::upper_bound(saddles.begin(), at, *at, higher), at, at + 1);
    }
    for (const Saddle& saddle : saddles) {
      std::size_t low = saddle.peak;
      std::size_t high = basin_[here];
      if (values_[high] < values_[low]) {
        std::swap(low, high);
      }
      if (saddle.height > limits_.ratio * values_[low] || values_[low] - saddle.height < limits_.depth) {
        std::replace(basin_.begin(), basin_.end(), low, high);
      }
    }
  }

  Vector<Saddle> saddles_beside(std::size_t here) const {
    Vector<Saddle> saddles;
    const auto& around = grid_.neighbours(region_[here]);
    for (std::size_t direction = 0; direction < around.size(); ++direction) {
      const std::size_t other = around[direction] == Grid::kOutside ? region_.size() : place(around[direction]);
      if (other == region_.size() || basin_[other] == kDry) {
        continue;
      }
      const double height = saddle_height(here, other, direction);
      const auto known = std::find_if(saddles.begin(), saddles.end(),
                                      [&](const Saddle& saddle) { return saddle.peak == basin_[other]; });
      if (known == saddles.end()) {
        saddles.push_back({basin_[other], std::max(height, 0.0)});
      } else {
        known->height = std::max(height, known->height);
      }
    }
    return saddles;
  }

  /// Height of the path from a taxel to a neighbour [N]. Between diagonal neighbours the force is about the mean of
  /// the four taxels there, but higher under a cylinder.
  double saddle_height(std::size_t here, std::size_t other, std::size_t direction) const {
    const auto [down, right] = Grid::kOffsets[direction];
    if (down == 0 || right == 0) {
      return values_[here];
    }
    const auto& around = grid_.neighbours(region_[here]);
    const double beside = std::max(force_[around[right < 0 ? 3 : 4]], 0.0);
    const double above = std::max(force_[around[down < 0 ? 1 : 6]], 0.0);
    const double share = 0.25 * limits_.ratio / kSaddleRatio;
    return std::min(values_[here], share * (values_[here] + values_[other] + (beside + above)));
  }

  const Grid& grid_;
  const Taxels& region_;
  const double* force_;
  Limits limits_;
  Vector<double> values_;      ///< Force of each taxel of the region [N].
  Vector<std::size_t> basin_;  ///< Peak to which each belongs.
};

SaddleFinder::SaddleFinder(const Grid& grid, double spread, double threshold) : grid_(grid), threshold_(threshold) {
  const double pitch = grid.largest_pitch();
  const double width = spread * spread + pitch * pitch / 12.0;
  least_major_axis_ = std::sqrt(width + kElongation * (pitch * pitch));
}

Vector<Point> SaddleFinder::peaks(const Footprint& footprint, const double* force, const bool* interpolated,
                                  bool were_apart) const {
  const Taxels& region = footprint.region;
  if (region.size() > kLargest || (interpolated == nullptr && has_one_peak(region, force))) {
    return {};
  }
  const Limits limits =
      were_apart ? Limits{kShallowSaddleRatio, kShallowSaddleDepth * threshold_} : Limits{kSaddleRatio, threshold_};
  const Taxels found = Watershed(grid_, region, force, interpolated, limits).peaks();
  if (found.size() < 2 || has_hole(footprint.members, force)) {
    return {};
  }
  Vector<Point> positions;
  std::transform(found.begin(), found.end(), std::back_inserter(positions),
                 [&](Taxel taxel) { return grid_.position(taxel); });
  return positions;
}

/// Whether at most one taxel of a region reads more than its four direct neighbours.
bool SaddleFinder::has_one_peak(const Taxels& region, const double* force) const {
  const auto is_peak = [&](Taxel taxel) {
    const auto& around = grid_.neighbours(taxel);
    return std::all_of(Grid::kEdges.begin(), Grid::kEdges.end(), [&](std::size_t direction) {
      return around[direction] == Grid::kOutside || force[taxel] >= force[around[direction]];
    });
  };
  return std::count_if(region.begin(), region.end(), is_peak) < 2;
}

/// Whether one of the taxels lacks its force because it is faulty.
bool SaddleFinder::has_hole(const Taxels& members, const double* force) const {
  return std::any_of(members.begin(), members.end(), [&](Taxel taxel) {
    const double least = neighbour_lower_bound(grid_, force, nullptr, taxel, nullptr);
    return least > 2.0 * threshold_ && force[taxel] < kHole * least;
  });
}

}  // namespace posfet
