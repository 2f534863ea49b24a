// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/zero_refutation.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"

namespace posfet {

void ZeroRefutation::count(double deviations, double rate) {
  const bool turned = (rate - resting_rate_) * per_kelvin_ > 0.0;
  in_turn_ = turned && lag_known_ && deviations > kSurprising ? in_turn_ + 1 : 0;
}

void ZeroRefutation::end_block(double duration, double age, double rate, bool listed, bool rested) {
  hidden_ *= listed ? 0.0 : std::exp(-duration / kMemory);
  if (rested) {
    resting_rate_ += duration / std::min(std::max(age, duration), kMemory) * (rate - resting_rate_);
  }
}

}  // namespace posfet
