// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/jump_noise.hpp"

#include <algorithm>

#include "posfet_core/estimation/signal_steps.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

JumpNoise::JumpNoise(const std::vector<double>& time_constant)
    : tau_(time_constant), squares_(tau_.size(), 0.0), time_(tau_.size(), 0.0) {}

void JumpNoise::observe(const bool* where, const double* step, const double* change, const double* noise,
                        double duration) {
  const auto falls = [&](std::size_t taxel) {
    return where[taxel] && change[taxel] < 0.0 && square(change[taxel]) > 2.0 * kStep * kStep * noise[taxel];
  };
  std::size_t falling = 0;
  for (std::size_t taxel = 0; taxel < tau_.size(); ++taxel) {
    falling += falls(taxel) ? 1 : 0;
  }
  for (std::size_t taxel = 0; taxel < tau_.size(); ++taxel) {
    if (!where[taxel]) {
      continue;
    }
    time_[taxel] += duration;
    double seen = square(step[taxel]);
    // A rise may be a touch that is too weak to be listed, and falls of several taxels the release of one that was
    // there at the start. Levels are left as often as they are taken: falls count twice.
    if (seen == 0.0 && falling == 1 && falls(taxel)) {
      seen = 2.0 * square(change[taxel]);
    }
    const double rate = seen / kStepSeen / duration;
    const double share = duration / std::min(std::max(time_[taxel], kLeastJumpMemory), kJumpMemory);
    squares_[taxel] += share * (rate - squares_[taxel]);
    admit(taxel, step[taxel]);
  }
}

void JumpNoise::admit(std::size_t taxel, double step) {
  squares_[taxel] = std::max(squares_[taxel], square(step) / kDwell);  // however long it was quiet before
}

double JumpNoise::variance(std::size_t taxel, double duration) const {
  const double ratio = 0.5 * kDwell / tau_[taxel];
  return squares_[taxel] * (1.0 + ratio * ratio) * duration;
}

}  // namespace posfet
