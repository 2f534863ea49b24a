// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/hidden_force.hpp"

#include <algorithm>
#include <cmath>

#include "force_estimator_constants.hpp"
#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Share of a force that a tap has lost from one block to the next [1]; warmth takes a second for it.
constexpr double kTapShare = 0.25;

}  // namespace

HiddenForce::HiddenForce(const EstimatedArray& array, const ContactSurroundings& surroundings)
    : array_(array),
      surroundings_(surroundings),
      least_force_(array.priors.warmth_force / array.priors.warmth_force_spread),
      felt_(array.taxels(), 0.0),
      tapped_(array.taxels()),
      values_(array.taxels(), 0.0) {}

void HiddenForce::follow(const Block& block, const Belief& belief, const Shown& shown) {
  const double follows = -std::expm1(-block.duration / array_.priors.warmth_time);
  const double kelvin = std::hypot(belief.shared[kWarmth], std::sqrt(belief.variance(kWarmth)));
  find_taps(block, shown);
  TaxelFlags near_taps(felt_.size());
  surroundings_.dilate(tapped_, near_taps);
  for (std::size_t taxel = 0; taxel < felt_.size(); ++taxel) {
    const bool counts = shown.begins && shown.touched[taxel] && !tapped_[taxel];
    const double read = counts ? felt_[taxel] + shown.absorbed[taxel] : 0.0;
    const double variance = block.noise[taxel] + belief.own_variance(taxel);
    const bool presses = square(read) > square(kSurprising) * variance && !near_taps[taxel];
    const double force = read + (presses ? values_[taxel] : 0.0);
    const double share = -std::expm1(-force / least_force_);
    values_[taxel] += follows * (std::abs(array_.newton_per_kelvin[taxel]) * kelvin * share - values_[taxel]);
  }
}

/// Find the touched taxels that have been tapped, and keep what each reads.
void HiddenForce::find_taps(const Block& block, const Shown& shown) {
  for (std::size_t taxel = 0; taxel < felt_.size(); ++taxel) {
    const double force = std::max(shown.force[taxel], 0.0);
    const double fallen = felt_[taxel] - force;
    const bool tap = fallen > kTapShare * felt_[taxel] && square(fallen) > square(kGate) * 2.0 * block.noise[taxel];
    tapped_[taxel] = shown.touched[taxel] && (tapped_[taxel] || tap);
    felt_[taxel] = force;
  }
}

}  // namespace posfet
