// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/moved_share.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Greatest change of a taxel's share of the force that is no motion [1]: the deviation of its force, between these.
/// What changes more has moved, however uncertain the force is.
constexpr double kLeastPlay = 2e-3;
constexpr double kGreatestPlay = 0.02;

/// Sum of the shares up to which the touch has just begun [1]: no sum of plays alone.
constexpr double kBegun = 0.51;

}  // namespace

double MovedShare::update(const std::vector<double>& force, const std::vector<double>& deviation) {
  const double total = sum(force);
  double before = 0.0;
  double moved = 0.0;
  for (std::size_t taxel = 0; taxel < share_.size(); ++taxel) {
    double share = 0.0;
    double play = kLeastPlay;
    if (total > 0.0) {
      share = force[taxel] / total;
      play = std::min(std::max(deviation[taxel] / total, kLeastPlay), kGreatestPlay);
    }
    const double now = std::min(std::max(share_[taxel], share - play), share + play);
    before += share_[taxel];
    moved += std::abs(now - share_[taxel]);
    share_[taxel] = now;
  }
  return total > 0.0 && before > kBegun ? 0.5 * moved : 0.0;  // a touch that begins has not moved
}

}  // namespace posfet
