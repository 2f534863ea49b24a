// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/jump_noise.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace posfet {

JumpNoise::JumpNoise(std::vector<double> time_constant)
    : tau_(std::move(time_constant)), squares_(tau_.size(), 0.0), time_(tau_.size(), 0.0) {}

void JumpNoise::observe(const bool* where, const double* change, const double* since, double lag, const double* noise,
                        double duration) {
  for (std::size_t taxel = 0; taxel < tau_.size(); ++taxel) {
    if (!where[taxel]) {
      continue;
    }
    time_[taxel] += duration;
    const double square = change[taxel] * change[taxel];
    const bool seen = square > 2.0 * kStep * kStep * noise[taxel];
    const double rate = seen ? steps(taxel, change[taxel], since[taxel], lag) / kStepSeen * square / duration : 0.0;
    const double share = duration / std::min(std::max(time_[taxel], kLeastJumpMemory), kJumpMemory);
    squares_[taxel] += share * (rate - squares_[taxel]);
  }
}

/// Number of steps that a change stands for.
///
/// A rise may be a touch that is too weak to be listed: its charge leaks, that of a step stays. A change that does not
/// stay, or of which that cannot be told, counts if it is a fall, and twice: levels are left as often as they are
/// taken.
double JumpNoise::steps(std::size_t taxel, double change, double since, double lag) const {
  const double leaked = -std::expm1(-lag / tau_[taxel]);
  if (leaked >= kToldLeak && std::abs(since) < 0.5 * leaked * std::abs(change)) {
    return 1.0;
  }
  return change < 0.0 ? 2.0 : 0.0;
}

double JumpNoise::variance(std::size_t taxel, double duration) const {
  const double ratio = 0.5 * kDwell / tau_[taxel];
  return squares_[taxel] * (1.0 + ratio * ratio) * duration;
}

}  // namespace posfet
