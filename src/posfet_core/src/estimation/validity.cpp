// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/validity.hpp"

#include <algorithm>

namespace posfet {

bool NegativeForceMonitor::update(const bool* where, const double* mean, double limit, const bool* still,
                                  double duration, bool* confirmed) {
  bool any = false;
  for (std::size_t taxel = 0; taxel < steady_.size(); ++taxel) {
    const bool steady = where[taxel] && mean[taxel] < -limit && still[taxel];
    steady_[taxel] = steady ? steady_[taxel] + duration : 0.0;
    confirmed[taxel] = steady_[taxel] >= steady_time_;
    if (confirmed[taxel]) {
      steady_[taxel] = 0.0;
      any = true;
    }
  }
  return any;
}

void NegativeForceMonitor::reset() { std::fill(steady_.begin(), steady_.end(), 0.0); }

void LowerBoundMonitor::start(const double* before, const double* remaining) {
  for (std::size_t taxel = 0; taxel < mask_.size(); ++taxel) {
    const bool held = before[taxel] > threshold_ && remaining[taxel] > -threshold_;
    mask_[taxel] = mask_[taxel] || held || remaining[taxel] > threshold_;
  }
  quiet_ = 0.0;
}

void LowerBoundMonitor::update(const double* force, double elapsed) {
  if (!mask_.any()) {
    return;
  }
  bool measurable = false;
  for (std::size_t taxel = 0; taxel < mask_.size(); ++taxel) {
    mask_[taxel] = mask_[taxel] && force[taxel] > -threshold_;
    measurable = measurable || (mask_[taxel] && force[taxel] > threshold_);
  }
  quiet_ += measurable ? 0.0 : elapsed;
  if (quiet_ >= release_time_) {
    clear();
  }
}

}  // namespace posfet
