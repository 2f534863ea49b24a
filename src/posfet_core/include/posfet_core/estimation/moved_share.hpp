// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// How much of a touch moves from taxel to taxel.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "posfet_core/numbers.hpp"

namespace posfet {

/// Follows each taxel's share of the total force. It does so with a play, as tremor and errors change shares, too:
/// those of weak forces lag behind.
class MovedShare {
public:
  /// Greatest change of a taxel's share of the force that is no motion [1]: the deviation of its force, between these.
  /// What changes more has moved, however uncertain the force is.
  static constexpr double kLeastPlay = 2e-3;
  static constexpr double kGreatestPlay = 0.02;

  /// Sum of the shares up to which the touch has just begun [1]: no sum of plays alone.
  static constexpr double kBegun = 0.51;

  explicit MovedShare(std::size_t taxels) : share_(taxels, 0.0) {}

  /// Process the forces of the touched taxels in a block, 0 of the others, with their standard deviations [N]. Returns
  /// the share of the force that has moved since the block before [1].
  double update(const std::vector<double>& force, const std::vector<double>& deviation) {
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

private:
  std::vector<double> share_;
};

}  // namespace posfet
