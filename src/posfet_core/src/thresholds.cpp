// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/thresholds.hpp"

#include <cmath>
#include <limits>

#include "posfet_core/numbers.hpp"

namespace posfet {

Thresholds::Thresholds(Taxel taxels, ContactThresholds contact) : contact_(contact) {
  const auto count = static_cast<std::size_t>(taxels);
  enter_.assign(count, contact.enter);
  release_.assign(count, contact.release);
  limit_ = enter_;
  for (auto* values : {&floor_, &recent_, &before_}) {
    values->assign(count, 0.0);
  }
  for (auto* mask : {&touched_, &next_, &since_update_}) {
    mask->assign(count, 0);
  }
}

void Thresholds::update(const double* force, const double* variance, const bool* usable, double duration) {
  const double kept = std::pow(kRecentDecay, duration / kRecentTime);
  for (std::size_t taxel = 0; taxel < touched_.size(); ++taxel) {
    const double deviation = std::sqrt(variance[taxel]);
    recent_[taxel] = std::fmax(force[taxel], kept * recent_[taxel]);
    const double residual = kResidualHysteresis * recent_[taxel];
    enter_[taxel] = maximum(maximum(contact_.enter, residual), kEnterDeviations * deviation);
    floor_[taxel] = deviation * kReleaseDeviations;
    if (touched_[taxel]) {
      floor_[taxel] = minimum(floor_[taxel], kHeldShare * recent_[taxel]);
    }
    release_[taxel] = maximum(maximum(contact_.release, residual), floor_[taxel]);
    if (usable != nullptr && !usable[taxel]) {
      enter_[taxel] = release_[taxel] = floor_[taxel] = std::numeric_limits<double>::infinity();
    }
    const bool releasing = since_update_[taxel] && before_[taxel] - force[taxel] > kReleasing * contact_.enter;
    since_update_[taxel] = touched_[taxel] || releasing;
    before_[taxel] = force[taxel];
  }
  choose_limits();
}

bool Thresholds::apply(const double* force) {
  for (std::size_t taxel = 0; taxel < touched_.size(); ++taxel) {
    next_[taxel] = force[taxel] >= limit_[taxel];
  }
  if (next_ == touched_) {
    return false;
  }
  touched_.swap(next_);
  choose_limits();
  for (std::size_t taxel = 0; taxel < touched_.size(); ++taxel) {
    since_update_[taxel] |= touched_[taxel];
  }
  return true;
}

bool Thresholds::any(const double* force) const {
  bool found = false;
  for (std::size_t taxel = 0; taxel < limit_.size(); ++taxel) {
    found = found || force[taxel] >= limit_[taxel];
  }
  return found;
}

void Thresholds::raise_recent(const double* force) {
  for (std::size_t taxel = 0; taxel < recent_.size(); ++taxel) {
    recent_[taxel] = std::fmax(recent_[taxel], force[taxel]);
  }
}

void Thresholds::choose_limits() {
  for (std::size_t taxel = 0; taxel < touched_.size(); ++taxel) {
    limit_[taxel] = touched_[taxel] ? release_[taxel] : enter_[taxel];
  }
}

}  // namespace posfet
