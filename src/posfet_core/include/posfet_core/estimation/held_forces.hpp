// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Forces of weakly touched taxels beside what certainly presses, and rests.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// Share by which the forces beside a taxel may change as nothing moves [1]: a hand trembles.
constexpr double kHeldPlay = 0.1;

/// Time for which they must not change more [s].
constexpr double kHeldTime = 0.1;

/// Follows the force of each taxel until those beside it rest.
///
/// A warm film hides force, and where that is as strong as the force itself, a weak touch and none look the same. But
/// what certainly presses a taxel beside it does not change while the object rests: so it still presses the weak one,
/// as it did when it came to rest.
class HeldForces {
public:
  /// A grid that stays where it is.
  explicit HeldForces(const Grid& grid)
      : grid_(grid),
        beside_(static_cast<std::size_t>(grid_.taxels()), 0.0),
        force_(beside_.size(), 0.0),
        rested_(beside_.size(), 0.0) {}

  std::size_t taxels() const { return force_.size(); }

  /// Process a block of `duration` [s]: forces [N], >= 0, and which of them are certainly some.
  void update(const std::vector<double>& force, const TaxelFlags& certain, double duration) {
    for (std::size_t taxel = 0; taxel < force_.size(); ++taxel) {
      double sum = 0.0;
      bool presses = false;
      for (const Taxel other : grid_.neighbours(static_cast<Taxel>(taxel))) {
        if (other != Grid::kOutside) {
          sum += force[static_cast<std::size_t>(other)];
          presses = presses || certain[static_cast<std::size_t>(other)];
        }
      }
      const double before = beside_[taxel];
      beside_[taxel] = std::min(std::max(before, (1.0 - kHeldPlay) * sum), (1.0 + kHeldPlay) * sum);
      rested_[taxel] = presses && beside_[taxel] == before ? rested_[taxel] + duration : 0.0;
      if (rested_[taxel] < kHeldTime) {
        force_[taxel] = force[taxel];
      }
    }
  }

  /// Force of a taxel when those beside it came to rest [N]; 0: unknown, or they do not rest.
  double held(std::size_t taxel) const { return rested_[taxel] < kHeldTime ? 0.0 : force_[taxel]; }

private:
  const Grid& grid_;
  std::vector<double> beside_;  ///< Sum of the forces beside each taxel, but for small changes [N].
  std::vector<double> force_;   ///< Force at the last motion [N].
  std::vector<double> rested_;  ///< Time since then [s].
};

}  // namespace posfet
