// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/unexplained_residuals.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/rest_detector.hpp"

namespace posfet {

namespace {

/// Mean residual from which on residuals are no error that the filter expects [1]: as many deviations of that mean.
const double kPersistent = kGate / std::sqrt(2.0 * UnexplainedResiduals::kPersistentBlocks - 1.0);

}  // namespace

UnexplainedResiduals::UnexplainedResiduals(std::size_t taxels, double threshold)
    : small_(kSmall * threshold),
      rising_(taxels),
      below_(taxels, 0.0),
      steady_(taxels, 0.0),
      level_(taxels, 0.0),
      mean_(taxels, 0.0) {}

void UnexplainedResiduals::add_persistent(const bool* where, const double* residual, bool* odd) {
  for (std::size_t taxel = 0; taxel < mean_.size(); ++taxel) {
    mean_[taxel] = where[taxel] ? mean_[taxel] + (residual[taxel] - mean_[taxel]) / kPersistentBlocks : 0.0;
    odd[taxel] = odd[taxel] || mean_[taxel] > kPersistent;
  }
}

void UnexplainedResiduals::update(const bool* odd, const double* residual, const double* mean, const double* noise,
                                  double duration, bool* errors) {
  std::fill(errors, errors + below_.size(), false);
  if (std::none_of(odd, odd + below_.size(), [](bool each) { return each; })) {
    reset();
    return;
  }
  for (std::size_t taxel = 0; taxel < below_.size(); ++taxel) {
    const bool up = residual[taxel] > 0.0;
    rising_[taxel] = odd[taxel] && up;
    below_[taxel] = odd[taxel] && !up ? below_[taxel] + duration : 0.0;
    const bool moved = !rising_[taxel] || std::abs(mean[taxel] - level_[taxel]) > RestDetector::kStill * noise[taxel];
    level_[taxel] = moved ? mean[taxel] : level_[taxel];
    steady_[taxel] = moved ? 0.0 : steady_[taxel] + duration;
    errors[taxel] = below_[taxel] >= kNegativeTime || (steady_[taxel] >= kUnexplainedTime && residual[taxel] < small_);
    if (errors[taxel]) {
      below_[taxel] = steady_[taxel] = 0.0;
    }
  }
}

void UnexplainedResiduals::reset() {
  rising_.fill(false);
  std::fill(below_.begin(), below_.end(), 0.0);
  std::fill(steady_.begin(), steady_.end(), 0.0);
}

}  // namespace posfet
