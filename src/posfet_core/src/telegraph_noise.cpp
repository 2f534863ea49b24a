// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/telegraph_noise.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/neighbour_estimate.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

TelegraphDetector::TelegraphDetector(const SkinResponse& skin, double time_constant)
    : skin_(skin),
      time_constant_(time_constant),
      level_(static_cast<std::size_t>(skin.grid().taxels()), kUnknown),
      before_(level_),
      returns_(level_.size(), 0),
      age_(level_.size(), 0.0),
      quiet_(level_.size(), 0.0),
      dwell_(level_.size(), 0.0),
      means_(kStepSpan * level_.size(), kUnknown),
      change_(level_.size(), 0.0),
      step_variance_(level_.size(), 0.0),
      felt_(level_.size(), 0.0),
      new_(level_.size()),
      found_(level_.size()) {}

void TelegraphDetector::close_block(const double* mean, const double* variance, const bool* sound, double duration,
                                    bool touched) {
  const std::size_t count = taxels();
  std::copy_backward(means_.begin(), means_.end() - static_cast<std::ptrdiff_t>(count), means_.end());
  std::copy(mean, mean + count, means_.begin());
  const double agreeing = kAgreeing * std::sqrt(2.0);
  bool any_new = false;
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    age_[taxel] += duration;
    quiet_[taxel] += touched ? 0.0 : duration;
    dwell_[taxel] += duration;
    if (age_[taxel] > kReturnMemory) {
      returns_[taxel] = 0;
    }
    const double deviation = std::sqrt(variance[taxel]);
    const bool settled = std::abs(mean[taxel] - means_[count + taxel]) < agreeing * deviation;
    const bool near = std::abs(mean[taxel] - level_[taxel]) <= kLeastLevelStep * deviation;  // false before the first
    if (settled && near) {
      level_[taxel] = mean[taxel];
    }
    new_[taxel] = settled && !near;
    any_new = any_new || new_[taxel];
  }
  if (any_new) {
    find_returns(variance, sound);
  }
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    found_[taxel] = returns_[taxel] >= kReturns || (found_[taxel] && quiet_[taxel] <= kReturnMemory);
  }
}

/// Count which of the taxels on a new level have returned to the one before, without their neighbours; take the level.
void TelegraphDetector::find_returns(const double* variance, const bool* sound) {
  const std::size_t count = taxels();
  const double* const earlier = means_.data() + (kStepSpan - 1) * count;
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    const double change = means_[taxel] - earlier[taxel];
    change_[taxel] = std::isnan(change) ? 0.0 : change;
    step_variance_[taxel] = 2.0 * variance[taxel];
    felt_[taxel] = sound[taxel] ? std::abs(change_[taxel]) : 0.0;
  }
  for (std::size_t taxel = 0; taxel < count; ++taxel) {
    if (!new_[taxel]) {
      continue;
    }
    if (has_returned(taxel, sound)) {
      ++returns_[taxel];
      age_[taxel] = quiet_[taxel] = 0.0;
    }
    before_[taxel] = level_[taxel];
    level_[taxel] = means_[taxel];
    dwell_[taxel] = 0.0;
  }
}

/// Whether a taxel has returned to the level before the one that it leaves, and its neighbours felt nothing of it.
bool TelegraphDetector::has_returned(std::size_t taxel, const bool* sound) const {
  const double noise = kAgreeing * std::sqrt(step_variance_[taxel]);
  const double step = std::abs(means_[taxel] - level_[taxel]);
  const double tolerance = maximum(kLevelTolerance * step, noise);
  const bool near = std::abs(means_[taxel] - before_[taxel]) < tolerance;
  if (!near) {
    return false;
  }
  const auto index = static_cast<Taxel>(taxel);
  const SkinResponse::Finding felt =
      skin_.test(index, change_.data(), step_variance_.data(), sound, kStepCertainty, false);
  const bool leaks = -step * std::expm1(-dwell_[taxel] / time_constant_) > kLevelLeaked * tolerance;
  const double around = largest_neighbour(skin_.grid(), felt_.data(), index);
  return (felt.contradicted || (!felt.testable && leaks)) && around < kNeighbourStep * step + noise;
}

}  // namespace posfet
