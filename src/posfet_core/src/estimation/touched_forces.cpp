// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/touched_forces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "posfet_core/estimation/propagation.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Least force that stands in for an unknown one beside a contact [contact threshold].
constexpr double kLeastFelt = 0.1;

/// Force of which only is known that it has all of the thermal contact [N].
constexpr double kSaturating = std::numeric_limits<double>::infinity();

/// Deviations of a block's mean by which a force must change to have moved [1].
constexpr double kPlay = 4.0;

}  // namespace

TouchedForces::TouchedForces(const EstimatedArray& array, const ContactSurroundings& surroundings)
    : array_(array),
      surroundings_(surroundings),
      held_(surroundings.grid()),
      thermal_contact_(array.taxels(), array.priors.warmth_time, array.threshold) {
  for (auto* values : {&steady_, &felt_, &pressing_, &least_, &most_, &known_, &reading_}) {
    values->assign(array_.taxels(), 0.0);
  }
}

void TouchedForces::follow(Block& block, const Shown& shown) {
  for (std::size_t taxel = 0; taxel < steady_.size(); ++taxel) {
    // Without this play the path of the noise would count, which is long after a minute. A NaN does not stay.
    const double mean = shown.mean[taxel];
    const double play = kPlay * std::sqrt(block.noise[taxel]);
    steady_[taxel] = std::min(mean + play, std::max(mean - play, steady_[taxel]));
  }
  find_tails(block, shown.ignored);
  find_bounds(block, shown);
}

/// Find what the touch lets the taxels beside it feel.
void TouchedForces::find_tails(Block& block, const TaxelFlags& ignored) {
  if (!block.touched.any()) {
    std::fill(block.neighbour.begin(), block.neighbour.end(), 0.0);
    std::fill(block.tail.begin(), block.tail.end(), 0.0);
    return;
  }
  const double least = kLeastFelt * array_.threshold;
  for (std::size_t taxel = 0; taxel < felt_.size(); ++taxel) {
    felt_[taxel] = ignored[taxel] ? kUnknown : std::abs(steady_[taxel]);
  }
  surroundings_.complete(felt_, least);
  surroundings_.greatest_neighbour(felt_, block.neighbour);
  surroundings_.geometric_decline(felt_, least, block.tail);
  for (std::size_t taxel = 0; taxel < felt_.size(); ++taxel) {
    block.tail[taxel] = block.touched[taxel] ? 0.0 : block.tail[taxel];
  }
}

/// Find the forces of the contacts, and between which bounds they are.
void TouchedForces::find_bounds(const Block& block, const Shown& shown) {
  TaxelFlags near(steady_.size());
  surroundings_.dilate(block.listed, near);
  const double spread = 2.0 * tail_spread(array_.priors, shown.belief);
  for (std::size_t taxel = 0; taxel < steady_.size(); ++taxel) {
    // Without the force that is the warmth's own, which would keep itself up.
    const double by_warmth = array_.newton_per_kelvin[taxel] * shown.belief.shared[kWarmth] * shown.touch.warm()[taxel];
    const double tail = near[taxel] ? block.tail[taxel] : 0.0;
    const bool counts = near[taxel] && (!shown.ignored[taxel] || shown.informative[taxel]);
    pressing_[taxel] = counts ? std::max(steady_[taxel], 0.0) : 0.0;
    least_[taxel] = std::max(pressing_[taxel] + std::min(by_warmth, 0.0), array_.priors.tail * tail);
    most_[taxel] = std::max(pressing_[taxel], spread * tail);
  }
  follow_thermal_contact(shown, block.duration);
  if (array_.priors.warmth_certain <= 0.0) {
    return;
  }
  raise_to_held(shown, near, block.duration);
  for (std::size_t taxel = 0; taxel < steady_.size(); ++taxel) {
    if (near[taxel] && thermal_contact_.warmed(taxel)) {
      least_[taxel] = most_[taxel] = kSaturating;
    }
  }
}

double TouchedForces::hidden_share(const Belief& belief) const {
  return -array_.per_kelvin * belief.shared[kWarmth] / std::max(array_.priors.warmth_force, array_.threshold);
}

/// Raise what forces are at least, where warmth might be all of them, to what they were when what certainly presses
/// beside them came to rest.
void TouchedForces::raise_to_held(const Shown& shown, const TaxelFlags& near, double duration) {
  TaxelFlags certain(steady_.size());
  for (std::size_t taxel = 0; taxel < steady_.size(); ++taxel) {
    known_[taxel] = shown.ignored[taxel] ? 0.0 : pressing_[taxel];
    certain[taxel] = !shown.ignored[taxel] && least_[taxel] > array_.threshold;
  }
  held_.update(known_, certain, duration);
  for (std::size_t taxel = 0; taxel < steady_.size(); ++taxel) {
    if (near[taxel] && !certain[taxel]) {
      least_[taxel] = std::max(least_[taxel], held_.held(taxel));
    }
  }
}

/// Follow what the taxels read but for their warmth, where that may be all of a force.
void TouchedForces::follow_thermal_contact(const Shown& shown, double duration) {
  const std::vector<double>& shared = shown.belief.shared;
  if (hidden_share(shown.belief) <= 1.0) {
    thermal_contact_.reset();
    return;
  }
  for (std::size_t taxel = 0; taxel < steady_.size(); ++taxel) {
    const double warmed =
        shared[kWarmth] * shown.touch.warm()[taxel] + shared[kWeakWarmth] * shown.touch.range()[taxel];
    reading_[taxel] = shown.ignored[taxel] ? 0.0 : shown.mean[taxel] + array_.newton_per_kelvin[taxel] * warmed;
  }
  thermal_contact_.update(reading_, duration);
}

}  // namespace posfet
