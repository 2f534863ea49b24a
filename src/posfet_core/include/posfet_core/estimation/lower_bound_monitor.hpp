// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Forces known only as a lower bound, after an interruption.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "posfet_core/flags.hpp"

namespace posfet {

/// Marks the taxels whose force is known only as a lower bound after an interruption, until the touch ends.
///
/// The remaining charge was caused by a force, so at least that force is applied. A negative charge that lasts means
/// that the force was released. Where neither remains, a force that leaked away cannot be distinguished from no force;
/// after `release_time` it counts as no force. Touches in between do not restart that time: where touches repeat,
/// forces would never be valid.
class LowerBoundMonitor {
public:
  /// Least measurable force [N]; time for which a negative force must be steady to be none, and time without a
  /// measurable force, in all, after which no force is applied [s].
  LowerBoundMonitor(std::size_t taxels, double threshold, double negative_time, double release_time)
      : mask_(taxels),
        threshold_(threshold),
        negative_time_(negative_time),
        release_time_(release_time),
        negative_for_(taxels, 0.0) {}

  /// Taxels whose force is a lower bound.
  const TaxelFlags& mask() const { return mask_; }

  /// Mark taxels after an interruption, from the forces before it and the remaining charges as forces [N].
  void start(const double* before, const double* remaining) {
    for (std::size_t taxel = 0; taxel < mask_.size(); ++taxel) {
      const bool held = before[taxel] > threshold_ && remaining[taxel] > -threshold_;
      mask_[taxel] = mask_[taxel] || held || remaining[taxel] > threshold_;
    }
    std::fill(negative_for_.begin(), negative_for_.end(), 0.0);
    quiet_ = 0.0;
  }

  /// Process the mean forces [N] of a block of `elapsed` [s]; `still` are the taxels whose mean equals that of the
  /// block before within noise. Those of a force that was released are `ended`, and no longer marked.
  void update(const double* mean, const bool* still, double elapsed, bool* ended) {
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

  /// Mark no taxel.
  void clear() { mask_.fill(false); }

private:
  TaxelFlags mask_;
  double threshold_;
  double negative_time_;
  double release_time_;
  std::vector<double> negative_for_;  ///< Time for which a force has been negative and steady [s].
  double quiet_ = 0.0;                ///< Time without a measurable force since the interruption [s].
};

}  // namespace posfet
