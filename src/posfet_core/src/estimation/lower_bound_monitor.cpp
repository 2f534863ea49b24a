// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/lower_bound_monitor.hpp"

#include <algorithm>

namespace posfet {

void LowerBoundMonitor::start(const double* before, const double* remaining) {
  for (std::size_t taxel = 0; taxel < mask_.size(); ++taxel) {
    const bool held = before[taxel] > threshold_ && remaining[taxel] > -threshold_;
    mask_[taxel] = mask_[taxel] || held || remaining[taxel] > threshold_;
  }
  std::fill(negative_for_.begin(), negative_for_.end(), 0.0);
  quiet_ = 0.0;
}

void LowerBoundMonitor::update(const double* mean, const bool* still, double elapsed, bool* ended) {
  bool measurable = false;
  for (std::size_t taxel = 0; taxel < mask_.size(); ++taxel) {
    const bool negative = mask_[taxel] && mean[taxel] < -threshold_ && still[taxel];
    negative_for_[taxel] = negative ? negative_for_[taxel] + elapsed : 0.0;
    ended[taxel] = negative_for_[taxel] >= negative_time_;
    mask_[taxel] = mask_[taxel] && !ended[taxel];
    measurable = measurable || (mask_[taxel] && mean[taxel] > threshold_);
  }
  quiet_ += measurable ? 0.0 : elapsed;
  if (quiet_ >= release_time_) {
    clear();
  }
}

}  // namespace posfet
