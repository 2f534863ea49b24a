// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/total_certainty.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"

namespace posfet {

namespace {

/// Share of the greatest force of the last blocks below which the force falls as in a release [1].
constexpr double kReleasing = 0.9;

/// Blocks from the middle of one, whose force is known, to the end of the next, for which it decides [1].
constexpr double kDecided = 1.5;

}  // namespace

void TotalCertainty::add(double total) {
  total_ = total;
  recent_[next_] = std::abs(total);
  next_ = (next_ + 1) % recent_.size();
}

bool TotalCertainty::is_certain(double deviation, double noise, double most) const {
  if (total_ < -kSurprising * deviation - threshold_) {
    return false;
  }
  const double greatest = *std::max_element(recent_.begin(), recent_.end());
  const double present = std::abs(total_);
  const double least = present - kDecided * steepest_fall() - kGate * noise;
  const double force = present < kReleasing * greatest ? greatest : least;
  return deviation <= std::max(most * force, threshold_);
}

double TotalCertainty::steepest_fall() const {
  double fall = 0.0;
  for (std::size_t block = 1; block < recent_.size(); ++block) {
    const double before = recent_[(next_ + block - 1) % recent_.size()];
    fall = std::max(fall, before - recent_[(next_ + block) % recent_.size()]);
  }
  return fall;
}

}  // namespace posfet
