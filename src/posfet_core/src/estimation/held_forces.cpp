// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/held_forces.hpp"

#include <algorithm>
#include <utility>

namespace posfet {

HeldForces::HeldForces(Grid grid)
    : grid_(std::move(grid)),
      beside_(static_cast<std::size_t>(grid_.taxels()), 0.0),
      force_(beside_.size(), 0.0),
      rested_(beside_.size(), 0.0) {}

void HeldForces::update(const std::vector<double>& force, const TaxelFlags& certain, double duration) {
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

}  // namespace posfet
