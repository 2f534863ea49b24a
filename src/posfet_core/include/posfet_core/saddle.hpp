// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Peaks of a region that saddles separate (watershed).
#pragma once

#include <optional>

#include "posfet_core/footprint.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Greatest ratio of a saddle to the lower of its two peaks [1]: with the remaining gain errors, cylinders and pads
/// have no such saddle.
constexpr double kSaddleRatio = 0.6;

/// The same for contacts that were separate regions before [1]: a pad, too, may begin to touch in two spots, but soon
/// has no saddle.
constexpr double kShallowSaddleRatio = 0.8;

/// Least depth of such a saddle [contact threshold]; other saddles are at least one contact threshold deep.
constexpr double kShallowSaddleDepth = 0.2;

/// A region is examined when its variance along the major axis exceeds that of the skin by this much [pitch2].
constexpr double kElongation = 0.4;

/// A taxel that reads less than this share of the force interpolated from its neighbours is faulty, not a saddle [1].
constexpr double kHole = 0.3;

/// Greatest number of taxels of a region that is examined: a larger one is no group of fingertips, and costly.
constexpr std::size_t kLargest = 100;

/// Finds peaks on one array.
class SaddleFinder {
public:
  /// `spread` is that of the elastomer skin [m], `threshold` the contact threshold [N], the least depth of a saddle.
  SaddleFinder(const Grid& grid, double spread, double threshold);

  /// Force of a taxel above which a peak without an observable shallow saddle has none [N].
  double resolvable_force() const { return kShallowSaddleDepth * threshold_ / (1.0 - kShallowSaddleRatio); }

  /// Length of the major axis from which a region may contain several contacts [m].
  double least_major_axis() const { return least_major_axis_; }

  /// Positions [m] of the peaks of a region; empty for fewer than two.
  ///
  /// `force` are the forces of all taxels [N]. Taxels that are `interpolated` (null: none) are no saddle, and their
  /// neighbours belong to one peak. For a region that consists of several former regions (`were_apart`) a shallow
  /// saddle is sufficient.
  Vector<Point> peaks(const Footprint& footprint, const double* force, const bool* interpolated, bool were_apart) const;

private:
  /// What a saddle must be to separate two peaks.
  struct Limits {
    double ratio;  ///< Greatest ratio to the lower peak [1].
    double depth;  ///< Least depth below it [N].
  };

  class Watershed;

  bool has_one_peak(const Taxels& region, const double* force) const;
  bool has_hole(const Taxels& members, const double* force) const;

  const Grid& grid_;
  double threshold_;
  double least_major_axis_;
};

}  // namespace posfet
