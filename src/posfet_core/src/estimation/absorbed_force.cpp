// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/absorbed_force.hpp"

#include <algorithm>

#include "posfet_core/estimation/shared_states.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/medians.hpp"
#include "posfet_core/numbers.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

namespace {

/// Time over which errors are averaged [s], twice the time constant of that average; less for as long after a touch, as
/// what its end tells of the errors is no slow press.
constexpr double kAbsorbedTime = 5.0;

}  // namespace

AbsorbedForce::AbsorbedForce(const EstimatedArray& array, bool observable)
    : array_(array),
      observable_(observable),
      error_(array.taxels(), 0.0),
      offset_(array.taxels(), 0.0),
      untouched_for_(array.taxels(), 0.0),
      values_(array.taxels(), 0.0),
      fallen_(array.taxels(), 0.0) {}

void AbsorbedForce::restart(std::size_t taxel, const Belief& belief) {
  error_[taxel] = belief.error_of(taxel)[kForceError];
  offset_[taxel] = belief.error_of(taxel)[kOffset];
}

void AbsorbedForce::follow(const Passage& block, const Belief& belief, double film_rate, const TaxelFlags& beside) {
  const double warming = film_rate * block.duration;
  for (std::size_t taxel = 0; taxel < error_.size(); ++taxel) {
    const double* present = belief.error_of(taxel);
    const double leaking = offset_[taxel] / array_.time_constant[taxel] + belief.shared[kDrift];
    error_[taxel] +=
        block.duration * block.leak * leaking + array_.newton_per_kelvin[taxel] * warming * present[kPyroelectric];
    if (beside[taxel]) {
      continue;
    }
    untouched_for_[taxel] += block.duration;
    // Twice as fast as their age: what was estimated early, and so less well, is soon forgotten.
    const double time = std::min(std::max(untouched_for_[taxel], 2.0 * block.duration), kAbsorbedTime);
    const double share = 2.0 * block.duration / time;
    error_[taxel] += share * (present[kForceError] - error_[taxel]);
    offset_[taxel] += share * (present[kOffset] - offset_[taxel]);
  }
}

void AbsorbedForce::find(const Belief& belief, const TaxelFlags& touched, const TaxelFlags& ignored) {
  Vector<double> kelvins;
  for (std::size_t taxel = 0; taxel < error_.size(); ++taxel) {
    values_[taxel] = belief.error_of(taxel)[kForceError] - error_[taxel];
    if (observable_ && !touched[taxel] && !ignored[taxel]) {
      kelvins.push_back(values_[taxel] / array_.newton_per_kelvin[taxel]);
    }
  }
  const double film = kelvins.size() < kFewestForUniform ? 0.0 : median(kelvins);
  for (std::size_t taxel = 0; taxel < error_.size(); ++taxel) {
    const double own = values_[taxel] - film * array_.newton_per_kelvin[taxel];
    values_[taxel] = std::max(own, 0.0);
    fallen_[taxel] = untouched_for_[taxel] < kAbsorbedTime ? 0.0 : std::max(-own, 0.0);
  }
}

void AbsorbedForce::recall(std::size_t taxel, Belief& belief) const {
  double* error = belief.error_of(taxel);
  belief.own_of(taxel)[own_at(kForceError, kForceError)] += square(error[kForceError] - error_[taxel]);
  belief.own_of(taxel)[own_at(kOffset, kOffset)] += square(error[kOffset] - offset_[taxel]);
  error[kForceError] = error_[taxel];
  error[kOffset] = offset_[taxel];
}

}  // namespace posfet
