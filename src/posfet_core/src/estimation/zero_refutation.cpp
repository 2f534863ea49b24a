// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/zero_refutation.hpp"

#include <algorithm>

#include "posfet_core/estimation/release_detector.hpp"

namespace posfet {

void ZeroRefutation::refute() {
  peak_ = wide_ ? peak_ : 0.0;
  insignificant_ = 0.0;
  wide_ = true;
}

void ZeroRefutation::end_block(double duration, double total, double deviation) {
  significant_ = total > kSignificant * deviation;
  if (significant_) {
    peak_ = std::max(peak_, total);
    insignificant_ = 0.0;
    return;
  }
  insignificant_ += duration;
  if (total < ReleaseDetector::kReleasedShare * peak_ || insignificant_ >= kMemory) {
    wide_ = false;
  }
}

}  // namespace posfet
